// Elements of a drawing, and its colours.

const SVG = "http://www.w3.org/2000/svg";

export function draw(tag, attributes, text) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  if (text) element.textContent = text;
  return element;
}

/** A colour of the page by its name, in the light or dark that is shown. */
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

export const faded = (hex, alpha) => hex + Math.round(255 * alpha).toString(16).padStart(2, "0");
