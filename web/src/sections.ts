// Sections of the page that follow from its data: overview, lens, optics, residuals, history.

import { chartOf, histogramOf, mapOf, spotsOf } from "./charts";
import { load } from "./data";
import { bytes, count, figure, h, measured, s, whenSeen } from "./dom";
import { timelineOf } from "./timeline";
import type { CameraPart, History, Optics, Page, ToldPart } from "./records";
import type { State } from "./state";

type Verdict = "passed" | "failed" | "none";

export function verdictOf(cameras: CameraPart[]): Verdict {
  const said = cameras.map((camera) => camera.certificate?.passed ?? null);
  if (said.some((one) => one === false)) return "failed";
  return said.length && said.every((one) => one === true) ? "passed" : "none";
}

export const VERDICTS: Record<Verdict, string> = { passed: "certificate passed", failed: "certificate FAILED", none: "no verdict" };

function card(name: string, value: string, remark: string): HTMLElement {
  return h("div", { class: "card" }, h("span", { class: "card-name" }, name), h("span", { class: "card-value" }, value), h("span", { class: "card-remark" }, remark));
}

export function overview(page: Page): HTMLElement[] {
  const rows = page.cameras.reduce((sum, camera) => sum + camera.views.reduce((more, view) => more + view.rows, 0), 0);
  const bodies = new Set(page.cameras.map((camera) => camera.name.split("@")[0])).size;
  const points = page.targets.reduce((sum, target) => sum + target.points, 0);
  const claims = page.cameras.flatMap((camera) => (camera.certificate?.max_px ? [camera.certificate.max_px as number] : []));
  return [
    h("div", { class: "cards" },
      card("rows of truth", count(rows), `${count(points)} target points in ${count(page.frames.length)} ${page.frames.length === 1 ? "frame" : "frames"}`),
      card("largest difference", claims.length ? `${measured(Math.max(...claims), 2)} px` : "–", "in the rows that the certificate solved again"),
      card("cameras", count(bodies), bodies === page.cameras.length ? [...new Set(page.cameras.map((one) => one.kind))].join(", ") : `${page.cameras.length} channels`),
      card("frames", count(page.frames.length), frames(page.frames)),
      card("targets", count(page.targets.length), page.targets.map((one) => `${one.kind}, ${one.points} points`).join("; ")),
      card("files", count(page.files), `${bytes(page.bytes)}, seed ${page.seed}`)),
    h("div", { class: "columns" }, certificates(page), seen(page)),
  ];
}

function frames(numbers: number[]): string {
  const last = numbers[numbers.length - 1], isRun = numbers.length > 2 && last - numbers[0] === numbers.length - 1;
  return numbers.length < 7 && !isRun ? numbers.join(", ") : `${numbers[0]} to ${last}`;
}

/** Per camera where mean, rms and largest difference lie beside the claim, on a logarithmic line. */
function certificates(page: Page): HTMLElement {
  const cards = page.cameras.flatMap((camera) => (camera.certificate ? [certificate(camera)] : []));
  const words = h("p", { class: "muted" }, "A sample of the rows, solved again by the other rule of integration: how far the two answers are apart, beside the accuracy that the build claims.");
  return h("div", { class: "panel" }, h("h3", {}, "Certificate"), words, ...cards);
}

function certificate(camera: CameraPart): HTMLElement {
  const found = camera.certificate!;
  const verdict = verdictOf([camera]);
  const [low, high, width] = [-7, 0, 100];
  const x = (value: number) => Math.max(0, Math.min(width, ((Math.log10(value) - low) / (high - low)) * width));
  const marks = ([["mean", found.mean_px], ["rms", found.rms_px], ["max", found.max_px]] as [string, number | null][])
    .filter((one): one is [string, number] => !!one[1]);
  const bars = (found.by_distance_from_cell_edge as any[]).filter((part) => part.rows).map((part) =>
    h("tr", {}, h("th", { scope: "row" }, `${part.from_px}${part.to_px === null ? " px and more" : ` to ${part.to_px} px`}`),
      h("td", { class: "number" }, count(part.rows)), h("td", { class: "number" }, measured(part.rms_px, 2)), h("td", { class: "number" }, measured(part.max_px, 2)),
      h("td", { class: "gauge-cell" }, h("span", { class: "gauge-bar", style: `width:${x(part.max_px)}%` }))));
  return h("div", { class: `certificate ${verdict}` },
    h("div", { class: "certificate-head" }, h("strong", {}, camera.name), h("span", { class: `pill ${verdict}` }, VERDICTS[verdict])),
    h("div", { class: "gauge", style: `--claim:${found.claim_px ? x(found.claim_px) : 100}%`, role: "img", "aria-label": marks.map(([name, value]) => `${name} ${figure(value)} px`).join(", ") + `, claim ${figure(found.claim_px)} px` },
      found.claim_px ? h("span", { class: "gauge-claim", style: `left:${x(found.claim_px)}%`, title: `claim ${found.claim_px} px` }) : null,
      ...marks.map(([name, value]) => h("span", { class: `gauge-mark ${name}`, style: `left:${x(value)}%`, title: `${name} ${value} px` }))),
    h("div", { class: "gauge-scale", "aria-hidden": "true" }, ...[-7, -6, -5, -4, -3, -2, -1, 0].map((power) => h("span", {}, power === 0 ? "1 px" : `10${[...String(power)].map((one) => "⁻⁰¹²³⁴⁵⁶⁷"["-01234567".indexOf(one)]).join("")}`))),
    h("p", { class: "legend" }, ...marks.map(([name, value]) => h("span", {}, h("i", { class: `gauge-mark ${name}` }), `${name} ${measured(value, 2)} px`))),
    h("p", {}, `${found.rows} of ${count(found.of)} rows`, found.claim_px ? ` · claim ${figure(found.claim_px)} px` : "", found.reason ? ` · ${found.reason}` : ""),
    bars.length > 1 ? h("details", {}, h("summary", {}, "by distance from the edge of the cell or image"), h("table", {}, h("thead", {}, h("tr", {}, ...["distance", "rows", "rms px", "largest px", ""].map((name) => h("th", { scope: "col" }, name)))), h("tbody", {}, ...bars))) : null);
}

/** Points seen per frame and camera. */
function seen(page: Page): HTMLElement {
  const rows = page.frames.map((frame) => h("tr", {}, h("th", { scope: "row" }, String(frame)), ...page.cameras.map((camera) => {
    const view = camera.views.find((one) => one.frame === frame);
    const share = view && view.of ? view.seen / view.of : 0;
    return h("td", { class: "seen", style: `--share:${share}` }, h("span", {}, view ? `${view.seen} of ${view.of}` : "–"), h("small", {}, view ? `${count(view.rows)} rows` : ""));
  })));
  const head = h("tr", {}, h("th", { scope: "col" }, "frame"), ...page.cameras.map((camera) => {
    const complete = camera.views.filter((view) => view.seen === view.of).length;
    return h("th", { scope: "col" }, camera.name, h("small", {}, `all points in ${complete} of ${camera.views.length} frames`));
  }));
  return h("div", { class: "panel" }, h("h3", {}, "Points seen"), h("div", { class: "scroll tall" }, h("table", {}, h("thead", {}, head), h("tbody", {}, ...rows))));
}

/** A part that is filled from the optics of the chosen camera when it comes into sight. */
function ofOptics(state: State, fill: (optics: Optics, camera: CameraPart) => Node[]): HTMLElement {
  const place = h("div", { "aria-busy": "true" });
  let begun = false;
  const show = async () => {
    const camera = state.camera;
    const nodes = camera.optics ? fill(await load<Optics>(camera.optics), camera) : [h("p", { class: "muted" }, "The stage of this build could not be read: no optics.")];
    if (camera !== state.camera) return;
    place.replaceChildren(...nodes);
    place.removeAttribute("aria-busy");
  };
  whenSeen(place, () => { begun = true; return show(); });
  state.on(["camera", "theme"], () => { if (begun) void show(); });
  return place;
}

export function lens(state: State): HTMLElement {
  return ofOptics(state, (optics, camera) => [
    h("div", { class: "drawing panel", role: "img", "aria-label": `section of ${camera.lens} with real rays` }, svg(optics.drawing)),
    h("div", { class: "figures" }, ...optics.figures.map((group) => h("div", { class: "panel" }, h("h3", {}, group.heading),
      h("table", {}, h("tbody", {}, ...group.rows.map((row) => h("tr", {}, h("th", { scope: "row" }, row.name), h("td", {}, row.value, row.remark ? h("small", {}, row.remark) : null)))))))),
  ]);
}

export function svg(text: string): SVGElement {
  const parsed = new DOMParser().parseFromString(text, "image/svg+xml").documentElement;
  parsed.removeAttribute("width");
  parsed.removeAttribute("height");
  return document.importNode(parsed, true) as unknown as SVGElement;
}

export function optics(state: State): HTMLElement {
  return ofOptics(state, (found) => [
    h("div", { class: "panel" }, h("h3", {}, "Spots"), h("p", { class: "muted" }, "Rays of one image position where they cross a plane of the scene, drawn in the image; the square is a pixel. In focus is where rays near the axis meet: with spherical aberration the smallest spot lies before or behind."), spotsOf(found.spots)),
    h("div", { class: "charts" }, ...found.charts.map((chart) => h("div", { class: "panel" }, chartOf(chart)))),
  ]);
}

export function residuals(state: State): HTMLElement {
  const place = h("div", {});
  const show = () => {
    const { residuals: found, width_px, height_px } = state.camera;
    const charts = [...found.histograms.map(histogramOf), ...(found.x_px.length ? [mapOf(found, width_px, height_px)] : [])];
    place.replaceChildren(charts.length ? h("div", { class: "charts" }, ...charts.map((one) => h("div", { class: "panel" }, one))) : h("p", { class: "muted" }, "No rows, no residuals."));
  };
  whenSeen(place, show);
  state.on(["camera"], show);
  return place;
}

/** What another plug-in tells of the chosen camera, and its pictures side by side. */
export function told(state: State, heading: string): HTMLElement {
  const place = h("div", { class: "told" });
  const show = async () => {
    const camera = state.camera;
    const script = camera.told[heading];
    const nodes = script ? toldOf(await load<ToldPart>(script), camera, heading) : [h("p", { class: "muted" }, heading === "Information" ? `Nothing has been asked of ${camera.name}: pipeline inform OUT ${camera.name} --report` : `Nothing is told of ${camera.name}.`)];
    if (camera === state.camera) place.replaceChildren(...nodes);
  };
  whenSeen(place, show);
  state.on(["camera"], () => void show());
  return place;
}

function toldOf(found: ToldPart, camera: CameraPart, heading: string): Node[] {
  const maps = h("div", { class: "panel drawing", role: "img", "aria-label": `${heading}: maps over the image` });
  if (found.drawing) maps.append(svg(found.drawing));
  const rows = camera.views.map((view) => ({ frame: view.frame, pictures: view.pictures.filter((one) => one.section === heading) })).filter((row) => row.pictures.length);
  const strips = rows.map((row) => h("div", { class: "side-by-side" }, ...row.pictures.map((one) => h("figure", {}, h("figcaption", {}, `frame ${row.frame}: ${one.kind}`),
    h("img", { src: one.tile_px ? `${one.path}/0/0_0.png` : one.path, alt: `frame ${row.frame}: ${one.kind}`, loading: "lazy", width: one.width_px, height: one.height_px })))));
  return [h("div", { class: "panel scroll" }, h("pre", {}, found.lines.join("\n"))), ...(found.drawing ? [maps] : []), ...(strips.length ? [h("div", { class: "panel" }, ...strips)] : [])];
}

export function history(state: State): HTMLElement {
  const place = h("div", {});
  whenSeen(place, () => load<History>(state.page.history).then((found) => {
    place.replaceChildren(...timelineOf(found), versions(state.page));
  }));
  return place;
}

function versions(page: Page): HTMLElement {
  return h("div", { class: "panel" }, h("h3", {}, "Made with"), h("p", { class: "versions" }, ...Object.entries(page.versions).map(([name, version]) => h("span", {}, `${name} `, h("code", {}, version)))));
}

export const logo = (): SVGElement => s("svg", { viewBox: "0 0 32 32", class: "logo", "aria-hidden": "true" },
  s("path", { d: "M16 3c6 7 6 19 0 26-6-7-6-19 0-26z", class: "logo-lens" }),
  s("path", { d: "M1 9 16 13 31 16M1 23 16 19 31 16", class: "logo-ray" }));
