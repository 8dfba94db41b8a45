// Poles of a stabilisation diagram, chosen by click or by keys: the file of `slowtime identify --select`.

const MOST_EDITS = 500;

function choosePoles(place) {
  const chart = place.querySelector(".chart"), panel = place.querySelector(".poles");
  const { ending, text, words } = JSON.parse(panel.querySelector("script").textContent);
  // Of the page as it is called now, so that its contents do not depend on its name.
  const page = decodeURIComponent(location.pathname.split("/").at(-1)), name = page.replace(/\.[^.]*$/, "") + ending;
  const edits = new Map();
  const say = (key, values = {}) => words[key].replace(/\{(\w+)\}/g, (_, value) => values[value]);
  const make = (tag, words, attributes = {}) => Object.assign(document.createElement(tag), { textContent: words, ...attributes });
  const hz = make("input", "", { type: "number", min: 0, step: "any" });
  const order = make("input", "", { type: "number", min: 1, step: 1 });
  const list = make("ol", ""), told = make("p", ""), save = make("button", say("save"), { type: "button" });
  told.setAttribute("role", "status");

  const lines = (edit) => [`- ${edit.action}: ${edit.hz}`, ...(edit.order ? [`  order: ${edit.order}`] : [])];
  const named = (edit) => `${edit.action} ${edit.hz} Hz${edit.order ? `, order ${edit.order}` : ""}`;

  function show() {
    list.replaceChildren(...[...edits].map(([key, edit]) => {
      const item = make("li", `${named(edit)} `);
      const remove = make("button", say("remove"), { type: "button", ariaLabel: `${say("remove")}: ${named(edit)}` });
      remove.addEventListener("click", () => { edits.delete(key); show(); save.focus(); });
      item.append(remove);
      return item;
    }));
    save.disabled = edits.size === 0;
  }

  // The same pole again takes its edit back.
  function toggle(edit) {
    const key = named(edit);
    if (!edits.delete(key)) {
      if (edits.size >= MOST_EDITS) { told.textContent = say("most", { n: MOST_EDITS }); return; }
      edits.set(key, edit);
    }
    told.textContent = say(edits.has(key) ? "chosen" : "back", { edit: key });
    show();
  }

  function typed(action) {
    if (!(hz.valueAsNumber > 0)) { told.textContent = say("above_zero"); hz.focus(); return; }
    const number = action === "keep" && order.valueAsNumber > 0 ? Math.round(order.valueAsNumber) : null;
    toggle({ action, hz: hz.valueAsNumber, order: number });
  }

  const ask = make("p", "");
  for (const [label, field] of [["frequency", hz], ["order", order]]) {
    const around = make("label", `${say(label)} `);
    around.append(field);
    ask.append(around, " ");
  }
  for (const [action, label] of [["keep", say("keep")], ["drop", say("drop")]]) {
    const act = make("button", label, { type: "button" });
    act.addEventListener("click", () => typed(action));
    ask.append(act, " ");
  }
  save.addEventListener("click", () => {
    const file = new Blob([`${text}${[...edits.values()].flatMap(lines).join("\n")}\n`], { type: "text/yaml" });
    const link = make("a", "", { href: URL.createObjectURL(file), download: name });
    link.click();
    URL.revokeObjectURL(link.href);
    told.textContent = say("saved", { name });
  });
  panel.append(
    make("p", say("how")),
    ask, list, save, told);
  show();

  chart.on("plotly_click", ({ points }) => {
    const point = points.find(({ data }) => data.meta === "mode" || data.meta === "other pole");
    if (!point) return;
    const keeps = point.data.meta === "other pole";
    toggle({ action: keeps ? "keep" : "drop", hz: keeps ? point.x : point.customdata, order: keeps ? point.y : null });
  });
}

document.addEventListener("drawn", () => document.querySelectorAll(".choice").forEach(choosePoles));
