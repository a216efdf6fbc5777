// The page: header, sections, keys.

import { load } from "./data";
import { fillAll, h } from "./dom";
import type { Page } from "./records";
import { SceneView } from "./scene3d";
import { history, lens, logo, optics, overview, residuals, told, verdictOf, VERDICTS } from "./sections";
import { State } from "./state";
import { ImageViewer } from "./viewer";

const KEYS: [string, string][] = [
  [", .", "frame before, next frame"], ["[ ]", "camera before, next camera"], ["1 – 6", "overlays of the image"], ["arrows + − 0", "move and zoom in the image"],
  ["n p", "next point, point before, in the image"], ["arrows + −", "move in space; turn with Shift"], ["t", "light, dark, as the system"], ["?", "this list"],
];

function section(id: string, title: string, ...content: Node[]): HTMLElement {
  return h("section", { id, "aria-labelledby": `${id}-title` }, h("h2", { id: `${id}-title` }, title), ...content);
}

function header(state: State, theme: () => void, help: () => void): HTMLElement {
  const { page } = state;
  const verdict = verdictOf(page.cameras);
  const cameras = h("select", { id: "camera", "aria-label": "Camera" }, ...page.cameras.map((camera, i) => h("option", { value: i }, camera.name)));
  cameras.addEventListener("change", () => state.chooseCamera(Number(cameras.value)));
  state.on(["camera"], () => { cameras.value = String(state.cameraIndex); });
  return h("header", {},
    h("a", { class: "brand", href: "#overview" }, logo(), h("span", {}, h("strong", {}, page.title), h("small", {}, page.stage))),
    h("span", { class: `pill ${verdict}`, role: "status" }, VERDICTS[verdict]),
    h("div", { class: "tools" }, cameras,
      h("button", { type: "button", id: "theme", title: "Light, dark, or as the system (t)", "aria-label": "Theme", onclick: theme }, "◐"),
      h("button", { type: "button", title: "Keys (?)", "aria-label": "Keys", onclick: help }, "?")));
}

/** Light, dark, or as the system: remembered where the browser allows it. */
function themes(state: State): () => void {
  const choices = ["", "light", "dark"];
  const set = (theme: string) => {
    if (theme) document.documentElement.dataset.theme = theme;
    else delete document.documentElement.dataset.theme;
    state.tell("theme");
  };
  const kept = () => { try { return localStorage.getItem("theme") ?? ""; } catch { return ""; } };
  set(kept());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => state.tell("theme"));
  return () => {
    const next = choices[(choices.indexOf(document.documentElement.dataset.theme ?? "") + 1) % choices.length];
    try { localStorage.setItem("theme", next); } catch { /* pages from disk may not remember */ }
    set(next);
  };
}

function keys(state: State, viewer: ImageViewer, theme: () => void, help: () => void): void {
  const steps: Record<string, () => void> = {
    ",": () => state.step(0, -1), ".": () => state.step(0, 1), "[": () => state.step(-1, 0), "]": () => state.step(1, 0), t: theme, "?": help,
  };
  document.addEventListener("keydown", (event) => {
    const typing = (event.target as Element).closest("input, select, textarea, dialog");
    if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
    if (steps[event.key]) steps[event.key]();
    else if (!viewer.press(event.key)) return;
    event.preventDefault();
  });
}

/** Marks the link of the section that is read: the last of those that cross a strip below the header. */
function follow(links: HTMLAnchorElement[]): void {
  const crossing = new Set<string>();
  const watcher = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (entry.isIntersecting) crossing.add(`#${entry.target.id}`);
      else crossing.delete(`#${entry.target.id}`);
    }
    const current = [...links].reverse().find((link) => crossing.has(link.hash));
    for (const link of current ? links : []) {
      if (link === current) mark(link);
      else link.removeAttribute("aria-current");
    }
  }, { rootMargin: "-20% 0px -70% 0px" });
  document.querySelectorAll("section").forEach((one) => watcher.observe(one));
}

/** Marks a link, and brings it into sight where a narrow window cuts the row of links. */
function mark(link: HTMLAnchorElement): void {
  link.setAttribute("aria-current", "location");
  const row = link.parentElement!;
  row.scrollLeft = link.offsetLeft - row.offsetLeft - (row.clientWidth - link.offsetWidth) / 2;
}

async function begin(): Promise<void> {
  const page = await load<Page>("data/page.js");
  document.title = `${page.title} – report`;
  const state = new State(page);
  const theme = themes(state);
  const dialog = h("dialog", { "aria-label": "Keys" }, h("h2", {}, "Keys"), h("dl", {}, ...KEYS.flatMap(([key, words]) => [h("dt", {}, h("kbd", {}, key)), h("dd", {}, words)])), h("form", { method: "dialog" }, h("button", {}, "Close")));
  const viewer = new ImageViewer(state);
  const headings = [...new Set(page.cameras.flatMap((one) => Object.keys(one.told)))];
  const parts = [
    section("overview", "Overview", ...overview(page)), section("images", "Images and truth", viewer.element),
    section("scene", "In space", new SceneView(state).element), section("lens", "Lens", lens(state)), section("optics", "Spots and curves", optics(state)),
    section("residuals", "Residuals", residuals(state)),
    ...headings.map((heading) => section(heading.toLowerCase(), heading, told(state, heading))), section("build", "Build", history(state)),
  ];
  const links = parts.map((part) => h("a", { href: `#${part.id}` }, part.querySelector("h2")!.textContent!));
  document.body.replaceChildren(
    h("a", { class: "skip", href: "#images" }, "Skip to the images"), header(state, theme, () => dialog.showModal()),
    h("nav", { "aria-label": "Sections" }, ...links), h("main", {}, ...parts),
    h("footer", {}, "Written by plenoptic-pipeline. three.js, OpenSeadragon and uPlot: see ", h("a", { href: "LICENSES.txt" }, "LICENSES.txt"), "."), dialog);
  keys(state, viewer, theme, () => dialog.showModal());
  follow(links);
  const land = () => { if (location.hash) document.querySelector(location.hash)?.scrollIntoView(); };
  addEventListener("hashchange", () => void fillAll().then(land));
  addEventListener("beforeprint", () => void fillAll());
  land();
  document.documentElement.dataset.ready = "yes";
  setTimeout(() => void fillAll().then(land), 200); // what is on the screen comes first
}

begin().catch((error: Error) => document.body.replaceChildren(h("p", { class: "failed-to-load", role: "alert" }, `The report cannot be shown: ${error.message}`)));
