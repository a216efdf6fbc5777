// Elements of the page, and words of numbers.

type Child = Node | string | null | undefined | false;
type Attributes = Record<string, unknown>;

const SVG = "http://www.w3.org/2000/svg";

function filled<E extends Element>(element: E, attributes: Attributes, children: Child[]): E {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value as EventListener);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...children.filter((child): child is Node | string => !!child || child === ""));
  return element;
}

/** An HTML element; attributes that begin with `on` are listeners. */
export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  return filled(document.createElement(tag), attributes, children);
}

/** An SVG element. */
export function s(tag: string, attributes: Attributes = {}, ...children: Child[]): SVGElement {
  return filled(document.createElementNS(SVG, tag) as SVGElement, attributes, children);
}

/** A number as people read it: so many significant digits, small ones with a power of ten. */
export function figure(value: number | null | undefined, digits = 3): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e-3 && size < 1e6) return String(Number(value.toPrecision(digits)));
  const [mantissa, power] = value.toExponential(digits - 1).split("e");
  const raised = [...String(Number(power))].map((one) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(one)]).join("");
  return Number(mantissa) === 1 ? `10${raised}` : `${Number(mantissa)} × 10${raised}`;
}

/** A measured number: as `figure`, with the zeros at its end. */
export function measured(value: number | null | undefined, digits = 3): string {
  const words = figure(value, digits);
  if (words === "–" || words === "0") return words;
  const size = Math.abs(value!);
  return size >= 1e-3 && size < 10 ** digits ? value!.toPrecision(digits) : words.replace(/^\S+(?= ×)/, () => value!.toExponential(digits - 1).split("e")[0]);
}

/** A number with all of its digits, as the tables on disk have it. */
export function exact(value: number | string | null): string {
  if (value === null) return "–";
  if (typeof value === "string" || value === 0 || Math.abs(value) >= 1e-4) return String(value);
  return value.toExponential().replace(/e-(\d)$/, "e-0$1");
}

/** A count with thin spaces between thousands. */
export function count(value: number): string {
  return value.toLocaleString("en").replace(/,/g, "\u202f");
}

/** A size in bytes. */
export function bytes(value: number | null): string {
  if (value === null) return "–";
  for (const [unit, size] of [["GB", 1e9], ["MB", 1e6], ["kB", 1e3]] as const)
    if (value >= size) return `${(value / size).toPrecision(3)} ${unit}`;
  return `${value} B`;
}

/** A duration. */
export function seconds(value: number | null): string {
  if (value === null) return "–";
  if (value < 60) return `${value.toFixed(value < 10 ? 2 : 1)} s`;
  const minutes = Math.floor(value / 60);
  return minutes < 60 ? `${minutes} min ${Math.round(value % 60)} s` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** A colour of the style sheet, for canvases. */
export function colour(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

const waiting = new Set<() => void>();
const running = new Set<Promise<void>>();

/** Runs once: when an element first comes near the screen, or with `fillAll`. */
export function whenSeen(element: Element, run: () => void | Promise<void>): void {
  const once = () => {
    if (!waiting.delete(once)) return;
    watcher.disconnect();
    running.add(Promise.resolve(run()));
  };
  const watcher = new IntersectionObserver((entries) => {
    if (entries.some((entry) => entry.isIntersecting)) once();
  }, { rootMargin: "300px" });
  waiting.add(once);
  watcher.observe(element);
}

/** Fills all that waits to be seen: who prints the page, or follows a link past it, needs its heights. */
export async function fillAll(): Promise<void> {
  for (const run of [...waiting]) run();
  await Promise.allSettled([...running]);
  for (let i = 0; i < 3; i++) await new Promise(requestAnimationFrame); // charts are drawn in the frame after that in which their size is seen
}

/** A button that stays pressed. */
export function toggle(name: string, key: string, pressed: boolean, change: (on: boolean) => void): HTMLButtonElement {
  const button = h("button", { type: "button", class: "toggle", "aria-pressed": String(pressed), "data-name": name }, name);
  if (key) button.append(h("kbd", { "aria-hidden": "true" }, key));
  button.addEventListener("click", () => {
    const on = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(on));
    change(on);
  });
  return button;
}
