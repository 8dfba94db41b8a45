// What the server is doing for the sites of whoever looks: uploads, replays, computations; and a way to end it.
import { t } from "./language.js";
import { ask, send } from "./link.js";
import { ago, button, composed, explain, make, say } from "./words.js";

const BASE = "/api/v1/holdings";
// Live streams are open pages, this one among them: nobody waits for those.
const WAITED_FOR = ({ kind }) => kind !== "streams";

export class UnderWay {
  constructor() {
    this.rows = new Map();
    this.root = make("section", undefined, "under-way");
    this.root.setAttribute("aria-label", t("under_way.title"));
    [this.told, this.list, this.problem] = [make("p", "", "facts"), make("ul", undefined, "cards wide-cards"), make("p", "", "alarm")];
    this.told.setAttribute("role", "status");
    this.problem.setAttribute("role", "alert");
    const head = make("div", undefined, "heading");
    head.append(make("h2", t("under_way.title")), this.told);
    this.root.append(head, this.problem, this.list);
  }

  refresh() {
    return this.attempt(() => ask(BASE));
  }

  async attempt(act) {
    try {
      this.tell(await act());
      this.problem.textContent = "";
    } catch (error) { explain(this.problem, error); }
  }

  tell({ holdings, quotas }) {
    const those = holdings.filter(WAITED_FOR), ids = new Set(those.map(({ id }) => id));
    const held = quotas.filter((quota) => WAITED_FOR(quota) && quota.held).map(({ kind, held: n, most }) => t("under_way.held", { kind: t(`under_way.kind.${kind}`), n, most }));
    say(this.told, "", held.join(" \u00b7 ") || t("under_way.none"));
    for (const [id, row] of this.rows) if (!ids.has(id)) { row.root.remove(); this.rows.delete(id); }
    for (const one of those) this.fill(this.rows.get(one.id) ?? this.row(one), one);
  }

  row({ id, kind, what }) {
    const root = make("li", undefined, "card"), about = make("p", "", "facts"), acts = make("p", undefined, "acts");
    root.dataset.holding = kind;
    const cancel = button(t("under_way.cancel"), () => this.attempt(() => send(`${BASE}/${id}`, "DELETE")), "administers");
    acts.append(cancel);
    root.append(composed("h3", what), about, acts);
    const row = { root, about, cancel };
    this.rows.set(id, row);
    this.list.append(root);
    return row;
  }

  fill(row, { kind, site, token, since_ns: since, cancellable }) {
    const whose = [site && t("under_way.site", { site }), token];
    row.about.textContent = [t(`under_way.kind.${kind}`), ...whose, t("under_way.began", { ago: ago(Date.now() - since / 1e6) })].filter(Boolean).join(" \u00b7 ");
    row.cancel.hidden = !cancellable;
  }
}
