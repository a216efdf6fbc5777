// The images of a frame: zoom to the pixel, overlays, and the row of the table under the pointer.

import OpenSeadragon from "openseadragon";
import { count, exact, figure, h, toggle, whenSeen } from "./dom";
import { load } from "./data";
import { draw, LAYERS, type Place } from "./overlays";
import type { MicroImageData, Picture } from "./records";
import { Rows, rowsOf } from "./rows";
import type { State } from "./state";
import { tableOf } from "./table";

const REACH = 16; // farthest point from the pointer that counts as pointed at [screen px]
const CLOSE = 24; // screen pixels per image pixel when a row is gone to

export class ImageViewer {
  readonly element: HTMLElement;
  private stage = h("div", { class: "viewer-stage", tabindex: "0", role: "application" });
  private canvas = h("canvas", { class: "overlay", "aria-hidden": "true" });
  private panel = h("div", { class: "row-panel", role: "status", "aria-live": "polite" });
  private kinds = h("select", { "aria-label": "Kind of image" });
  private status = h("output", { class: "viewer-status" });
  private slider = h("input", { type: "range", min: 0, step: 1, "aria-label": "Frame" });
  private table = h("div", {});
  private buttons = new Map<string, HTMLButtonElement>();
  private on = new Set(LAYERS.filter((layer) => layer.on).map((layer) => layer.name));
  private viewer: OpenSeadragon.Viewer | null = null;
  private shown: Picture | null = null;
  private rows: Rows | null = null;
  private images: MicroImageData | null = null;
  private chosen: number | null = null;
  private waiting = 0;
  private smooth = true;

  constructor(private state: State) {
    const layers = LAYERS.map((layer) => {
      const button = toggle(layer.name, layer.key, layer.on, (on) => this.switch(layer.name, on));
      this.buttons.set(layer.key, button);
      return button;
    });
    const zoom = h("div", { class: "zoom", role: "group", "aria-label": "Zoom" },
      ...([["−", "Zoom out", 0.5], ["+", "Zoom in", 2], ["1:1", "Zoom to 16 screen pixels per pixel", 0], ["⤢", "Show all", -1]] as const)
        .map(([sign, name, by]) => h("button", { type: "button", title: name, "aria-label": name, onclick: () => this.zoom(by) }, sign)));
    this.element = h("div", { class: "viewer" },
      h("div", { class: "bar" },
        h("label", { class: "frame-chooser" }, h("span", {}, "Frame"), this.slider), this.kinds,
        h("div", { class: "toggles", role: "group", "aria-label": "Overlays" }, ...layers), zoom),
      h("div", { class: "viewer-body" }, h("div", { class: "viewer-frame" }, this.stage, this.status), this.panel),
      this.table);
    this.stage.setAttribute("aria-label", "Image of the frame. Arrow keys move, plus and minus zoom, n and p go from point to point.");
    this.slider.addEventListener("input", () => state.chooseFrame(Number(this.slider.value)));
    this.kinds.addEventListener("change", () => this.open(Number(this.kinds.value), false));
    this.stage.addEventListener("keydown", (event) => this.key(event));
    state.on(["camera"], () => void this.show());
    state.on(["frame"], () => void this.show(true));
    whenSeen(this.element, () => { this.begin(); return this.show(); });
  }

  /** Presses the button of an overlay, or goes to the next point or to that before. */
  press(key: string): boolean {
    if (key === "n" || key === "p") {
      this.element.scrollIntoView({ block: "nearest" });
      this.next(key === "n" ? 1 : -1);
      return true;
    }
    this.buttons.get(key)?.click();
    return this.buttons.has(key);
  }

  private switch(name: string, on: boolean): void {
    if (on) this.on.add(name);
    else this.on.delete(name);
    this.redraw();
  }

  private begin(): void {
    this.viewer = OpenSeadragon({
      element: this.stage, drawer: "canvas", showNavigationControl: false, showNavigator: true, navigatorPosition: "BOTTOM_RIGHT",
      navigatorSizeRatio: 0.16, maxZoomPixelRatio: 96, minZoomImageRatio: 0.7, visibilityRatio: 0.4, animationTime: matchMedia("(prefers-reduced-motion: reduce)").matches ? 0 : 0.35,
      smoothTileEdgesMinZoom: Infinity, preserveImageSizeOnResize: true, immediateRender: true, keyboardNavEnabled: false,
      gestureSettingsMouse: { clickToZoom: false, dblClickToZoom: true }, gestureSettingsTouch: { clickToZoom: false },
    } as unknown as OpenSeadragon.Options);
    this.stage.append(this.canvas);
    this.viewer.addHandler("update-viewport", () => this.redraw());
    this.viewer.addOnceHandler("tile-drawn", () => performance.mark("first image"));
    this.viewer.addHandler("open", () => this.redraw());
    this.viewer.addHandler("canvas-click", () => this.stage.focus());
    this.viewer.addHandler("open-failed", () => { this.status.value = "the image is missing: write the report again"; });
    this.stage.addEventListener("pointermove", (event) => this.point(event));
    new ResizeObserver(() => this.redraw()).observe(this.stage);
  }

  /** Opens the chosen view. */
  private async show(stay = false): Promise<void> {
    const { camera, view } = this.state;
    this.slider.max = String(Math.max(0, camera.views.length - 1));
    this.slider.value = String(this.state.frameIndex);
    this.slider.disabled = camera.views.length < 2;
    this.slider.setAttribute("aria-valuetext", view ? `frame ${view.frame}` : "none");
    this.slider.previousElementSibling!.textContent = view ? `Frame ${view.frame} of ${camera.views.length}` : "No frames";
    const pictures = this.pictures();
    const before = this.kinds.selectedOptions[0]?.textContent;
    this.kinds.replaceChildren(...pictures.map((one, i) => h("option", { value: i }, one.kind)));
    const index = Math.max(0, pictures.findIndex((one) => one.kind === before));
    this.kinds.value = String(index);
    const turn = ++this.waiting;
    this.chosen = null;
    this.open(index, stay);
    this.tell();
    const rows = view ? await rowsOf(view.data) : null;
    const images = camera.micro_images ? await load<MicroImageData>(camera.micro_images) : null;
    if (turn !== this.waiting) return;
    [this.rows, this.images] = [rows, images];
    for (const layer of ["Outlines", "Lattice"])
      this.element.querySelector<HTMLElement>(`[data-name=${layer}]`)!.hidden = !images;
    this.table.replaceChildren(rows ? tableOf(rows, (row) => this.goTo(row)) : "");
    this.stage.dataset.rows = String(rows?.length ?? 0);
    this.tell();
    this.redraw();
  }

  private pictures(): Picture[] {
    return [...(this.state.view?.pictures ?? []), ...this.state.camera.pictures];
  }

  private open(index: number, stay: boolean): void {
    const picture = this.pictures()[index];
    if (!this.viewer || !picture) return;
    const bounds = stay || this.shown?.width_px === picture.width_px ? this.viewer.viewport?.getBounds(true) : null;
    const again = this.shown && this.shown.width_px === picture.width_px && this.shown.height_px === picture.height_px;
    this.shown = picture;
    this.stage.dataset.picture = picture.path;
    this.viewer.open(source(picture) as never);
    if (bounds && again) this.viewer.addOnceHandler("open", () => this.viewer!.viewport.fitBounds(bounds, true));
  }

  private zoom(by: number): void {
    const viewport = this.viewer?.viewport;
    if (!viewport || !this.shown) return;
    if (by < 0) viewport.goHome();
    else if (by === 0) viewport.zoomTo((16 * this.shown.width_px) / this.stage.clientWidth);
    else viewport.zoomBy(by);
    viewport.applyConstraints();
  }

  private key(event: KeyboardEvent): void {
    const viewport = this.viewer?.viewport;
    if (!viewport || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = 0.12 / viewport.getZoom(true);
    const moves: Record<string, () => void> = {
      ArrowLeft: () => viewport.panBy(new OpenSeadragon.Point(-step, 0)),
      ArrowRight: () => viewport.panBy(new OpenSeadragon.Point(step, 0)),
      ArrowUp: () => viewport.panBy(new OpenSeadragon.Point(0, -step)),
      ArrowDown: () => viewport.panBy(new OpenSeadragon.Point(0, step)),
      "+": () => this.zoom(1.5), "=": () => this.zoom(1.5), "-": () => this.zoom(1 / 1.5), "0": () => this.zoom(-1),
      n: () => this.next(1), p: () => this.next(-1),
    };
    if (!moves[event.key]) return;
    moves[event.key]();
    viewport.applyConstraints();
    event.preventDefault();
    event.stopPropagation();
  }

  private next(by: number): void {
    const many = this.rows?.length || 1;
    this.goTo(((this.chosen ?? (by > 0 ? -1 : 0)) + by + many) % many);
  }

  /** Moves to a row, and says it. */
  private goTo(row: number): void {
    if (!this.rows || !this.viewer || !this.shown || row >= this.rows.length) return;
    const viewport = this.viewer.viewport, width = this.shown.width_px;
    const x = this.rows.number("x_px", row) + 0.5, y = this.rows.number("y_px", row) + 0.5;
    const close = Math.max((CLOSE * width) / this.stage.clientWidth, viewport.getZoom());
    viewport.zoomTo(close);
    viewport.panTo(new OpenSeadragon.Point(x / width, y / width));
    this.choose(row);
    this.redraw();
  }

  private choose(row: number | null): void {
    this.chosen = row;
    this.tell();
  }

  private place(): Place | null {
    const item = this.viewer?.world.getItemAt(0);
    if (!item) return null;
    // The corner of the image is half a pixel before the centre of its first pixel.
    const corner = item.imageToViewerElementCoordinates(new OpenSeadragon.Point(0.5, 0.5));
    const next = item.imageToViewerElementCoordinates(new OpenSeadragon.Point(100.5, 0.5));
    return { x: corner.x, y: corner.y, scale: (next.x - corner.x) / 100, width: this.stage.clientWidth, height: this.stage.clientHeight };
  }

  private point(event: PointerEvent): void {
    const place = this.place(), rows = this.rows;
    if (!place || !rows) return;
    const box = this.stage.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    let best: number | null = null, nearest = REACH;
    for (let row = 0; row < rows.length; row++) {
      const away = Math.hypot(place.x + rows.number("x_px", row) * place.scale - x, place.y + rows.number("y_px", row) * place.scale - y);
      if (away < nearest) [best, nearest] = [row, away];
    }
    this.status.value = this.words(place, (x - place.x) / place.scale, (y - place.y) / place.scale);
    if (best !== null && best !== this.chosen) { this.choose(best); this.redraw(); }
  }

  private words(place: Place, x: number, y: number): string {
    return `(${x.toFixed(place.scale > 4 ? 1 : 0)}, ${y.toFixed(place.scale > 4 ? 1 : 0)}) px · ${figure(place.scale * 100, 3)} %`;
  }

  private redraw(): void {
    const place = this.place();
    if (!place) return;
    const dense = window.devicePixelRatio || 1;
    const [width, height] = [Math.round(place.width * dense), Math.round(place.height * dense)];
    if (this.canvas.width !== width || this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [width, height];
    const pen = this.canvas.getContext("2d")!;
    pen.setTransform(dense, 0, 0, dense, 0, 0);
    pen.clearRect(0, 0, place.width, place.height);
    if (this.smooth !== place.scale < 2) this.viewer!.drawer.setImageSmoothingEnabled((this.smooth = place.scale < 2)); // draws anew
    draw(pen, place, this.on, this.rows, this.images, this.chosen);
    this.stage.dataset.scale = String(place.scale);
    this.stage.dataset.corner = `${place.x} ${place.y}`;
    this.status.value = this.words(place, (place.width / 2 - place.x) / place.scale, (place.height / 2 - place.y) / place.scale);
  }

  private tell(): void {
    if (!this.rows || this.chosen === null) {
      const said = this.rows ? `${count(this.rows.length)} rows of truth in this image.` : "";
      this.panel.replaceChildren(h("h3", {}, "Row of the table"), h("p", { class: "muted" }, `${said} Point at a cross, or press n.`));
      return;
    }
    const cells = this.rows.row(this.chosen).flatMap(([name, value]) => [
      h("dt", {}, name), h("dd", { "data-column": name }, exact(value)),
    ]);
    this.panel.replaceChildren(h("h3", {}, `Row ${count(this.chosen + 1)} of ${count(this.rows.length)}`), h("dl", {}, ...cells));
  }
}

function source(picture: Picture): unknown {
  if (picture.tile_px === null) return { type: "image", url: picture.path, buildPyramid: false };
  return {
    width: picture.width_px, height: picture.height_px, tileSize: picture.tile_px, tileOverlap: 0, minLevel: 0, maxLevel: picture.levels - 1,
    getTileUrl: (level: number, x: number, y: number) => `${picture.path}/${level}/${x}_${y}.png`,
  };
}
