// Poles of a stabilisation diagram, chosen by click or by keys: the file of `slowtime identify --select`.

const MOST_EDITS = 500;

function choosePoles(place) {
  const chart = place.querySelector(".chart"), panel = place.querySelector(".poles");
  const { ending, text } = JSON.parse(panel.querySelector("script").textContent);
  // Of the page as it is called now, so that its contents do not depend on its name.
  const page = decodeURIComponent(location.pathname.split("/").at(-1)), name = page.replace(/\.[^.]*$/, "") + ending;
  const edits = new Map();
  const make = (tag, words, attributes = {}) => Object.assign(document.createElement(tag), { textContent: words, ...attributes });
  const hz = make("input", "", { type: "number", min: 0, step: "any" });
  const order = make("input", "", { type: "number", min: 1, step: 1 });
  const list = make("ol", ""), told = make("p", ""), save = make("button", "Save the choice of modes", { type: "button" });
  told.setAttribute("role", "status");

  const lines = (edit) => [`- ${edit.action}: ${edit.hz}`, ...(edit.order ? [`  order: ${edit.order}`] : [])];
  const words = (edit) => `${edit.action} ${edit.hz} Hz${edit.order ? `, order ${edit.order}` : ""}`;

  function show() {
    list.replaceChildren(...[...edits].map(([key, edit]) => {
      const item = make("li", `${words(edit)} `);
      const remove = make("button", "Remove", { type: "button", ariaLabel: `Remove: ${words(edit)}` });
      remove.addEventListener("click", () => { edits.delete(key); show(); save.focus(); });
      item.append(remove);
      return item;
    }));
    save.disabled = edits.size === 0;
  }

  // The same pole again takes its edit back.
  function toggle(edit) {
    const key = words(edit);
    if (!edits.delete(key)) {
      if (edits.size >= MOST_EDITS) { told.textContent = `At most ${MOST_EDITS} poles can be chosen.`; return; }
      edits.set(key, edit);
    }
    told.textContent = edits.has(key) ? `Chosen: ${key}.` : `Taken back: ${key}.`;
    show();
  }

  function typed(action) {
    if (!(hz.valueAsNumber > 0)) { told.textContent = "Give a frequency above 0 Hz."; hz.focus(); return; }
    const number = action === "keep" && order.valueAsNumber > 0 ? Math.round(order.valueAsNumber) : null;
    toggle({ action, hz: hz.valueAsNumber, order: number });
  }

  const ask = make("p", "");
  for (const [label, field] of [["Frequency [Hz] ", hz], ["Model order, if it matters ", order]]) {
    const around = make("label", label);
    around.append(field);
    ask.append(around, " ");
  }
  for (const [action, label] of [["keep", "Keep"], ["drop", "Drop"]]) {
    const act = make("button", label, { type: "button" });
    act.addEventListener("click", () => typed(action));
    ask.append(act, " ");
  }
  save.addEventListener("click", () => {
    const file = new Blob([`${text}${[...edits.values()].flatMap(lines).join("\n")}\n`], { type: "text/yaml" });
    const link = make("a", "", { href: URL.createObjectURL(file), download: name });
    link.click();
    URL.revokeObjectURL(link.href);
    told.textContent = `Saved as ${name}. Give it to: slowtime identify … --select ${name}`;
  });
  panel.append(
    make("p", "Click a pole: one of a mode drops that mode, another is kept as a mode. Or type it; the same once more takes it back."),
    ask, list, save, told);
  show();

  chart.on("plotly_click", ({ points }) => {
    const point = points.find(({ data }) => data.name === "mode" || data.name === "other pole");
    if (!point) return;
    const keeps = point.data.name === "other pole";
    toggle({ action: keeps ? "keep" : "drop", hz: keeps ? point.x : point.customdata, order: keeps ? point.y : null });
  });
}

document.addEventListener("drawn", () => document.querySelectorAll(".choice").forEach(choosePoles));
