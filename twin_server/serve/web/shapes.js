// A twin in space, of models that have a geometry: mode shapes, measured over model, changes of the elements and health of the sensors.
import { t } from "./language.js";
import { ask } from "./link.js";
import { digits, make, number, slowTime } from "./words.js";
import { WireframeView } from "./wireframe.js";

const ASK_MS = 2000;
const SPOKEN = { words: (key, values) => t(`wireframe.${key}`, values), digits, fixed: number };

/** Each sensor with its health: silent where nothing comes now, or missing from the reading that is shown. */
function withHealth(found, latest, past) {
  const silent = !past && (!latest.alive || latest.sensor?.sensor_silent_s > 0);
  const sensors = found.sensors.map((one) => ({ ...one, health: silent ? "silent" : one.measured ? "measures" : "missing" }));
  return { ...found, sensors };
}

export class Shapes {
  constructor() {
    Object.assign(this, { askedAt: 0, shown: null, view: null });
    this.root = make("section", undefined, "spatial");
    this.title = make("h3", t("shapes.title"));
    this.root.append(this.title);
    this.root.hidden = true;
  }

  async refresh({ latest, base, at }) {
    const model = latest?.registration.model;
    if (!model?.geometry) return this.forget();
    const key = `${latest.boot} ${latest.sequence} ${at?.slow_time} ${latest.alive} ${latest.sensor?.sensor_silent_s > 0}`;
    if (key === this.shown || Date.now() - this.askedAt < ASK_MS) return;
    this.askedAt = Date.now();
    const told = await ask(`${base}/shapes${at ? `?at=slow:${at.slow_time}` : ""}`).catch(() => null);
    if (!told) return;
    const found = withHealth(told, latest, at);
    this.shown = key;
    this.title.textContent = at ? t("shapes.title_at", { time: slowTime(found) }) : t("shapes.title_now");
    this.root.hidden = false;
    if (this.view) return this.view.show(found);
    this.view = new WireframeView(found, { spoken: SPOKEN });
    this.root.append(this.view.root);
  }

  forget() {
    this.root.hidden = true;
    this.close();
  }

  close() {
    this.view?.close();
    this.view?.root.remove();
    [this.view, this.shown] = [null, null];
  }
}
