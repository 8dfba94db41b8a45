// Questions to the server, and what it says when it will not answer them.
import { t } from "./language.js";

const PATIENCE_MS = 8000, ORDER_MS = 60000;

/** What came back, or an error that says what to do. */
async function fetched(path, options, patience) {
  try {
    const response = await fetch(path, { ...options, signal: AbortSignal.timeout(patience) });
    if (response.ok) return await response.json();
    const { detail } = await response.json().catch(() => ({}));
    const retry = Number(response.headers.get("Retry-After")) || 0;
    throw Object.assign(new Error(detail || response.statusText), { status: response.status, retry });
  } catch (error) {
    if (error.name !== "TimeoutError") throw error;
    throw new Error(t("error.timeout", { n: patience / 1000 }));
  }
}

export const ask = (path, patience = PATIENCE_MS) => fetched(path, { headers: { Accept: "application/json" } }, patience);

export function send(path, method, body) {
  const headers = body === undefined ? {} : { "Content-Type": "application/json" };
  return fetched(path, { method, headers, body: body && JSON.stringify(body) }, ORDER_MS);
}
