// What the address says: #lab.beam is a twin, #lab.beam?at=12.5 the same at a past slow time.

/** `{ view, id, at }`: fleet, recordings, or of the twin `id` its state or its diagnosis. */
export function where(hash) {
  const [path, query = ""] = decodeURIComponent(hash.replace(/^#/, "")).split("?", 2);
  if (!path || path.startsWith("/")) return { view: "fleet", id: null, at: null };
  if (path === "recordings") return { view: "recordings", id: null, at: null };
  const [id, room] = path.split("/", 2), at = new URLSearchParams(query).get("at");
  return { view: room === "diagnosis" ? "diagnosis" : "state", id, at: at === null || Number.isNaN(Number(at)) ? null : Number(at) };
}

export const toTwin = (id, room) => `#${id}${room === "diagnosis" ? "/diagnosis" : ""}`;

/** The instant shown becomes part of the address, so that it can be sent to somebody; it is no step back. */
export function remember(id, slowTime) {
  history.replaceState(null, "", slowTime === null ? toTwin(id) : `${toTwin(id)}?at=${slowTime}`);
}
