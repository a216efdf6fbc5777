// Cameras, boards and rays in space. Lengths in mm; the world is USD's, y up; a vision frame has y down and z forward.

import {
  AmbientLight, BufferAttribute, BufferGeometry, DirectionalLight, DoubleSide, Group, LatheGeometry, LineBasicMaterial,
  LineSegments, Matrix4, Mesh, MeshBasicMaterial, MeshPhongMaterial, PerspectiveCamera, Scene, Texture, TextureLoader, Vector2, Vector3,
  WebGLRenderer, Box3,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { load } from "./data";
import { colour, h, toggle, whenSeen } from "./dom";
import type { CameraPart, Optics, SurfaceShape, TargetPart, View } from "./records";
import type { State } from "./state";

const FANS = ["#e8483c", "#27a05a", "#2f7fe0"];
type Look = "all" | "lens" | "side" | "top";

export class SceneView {
  readonly element: HTMLElement;
  private box = h("div", { class: "scene-box", role: "img", tabindex: "0" });
  private note = h("p", { class: "muted scene-note" });
  private renderer: WebGLRenderer | null = null;
  private scene = new Scene();
  private eye = new PerspectiveCamera(35, 1, 1, 1e6);
  private controls: OrbitControls | null = null;
  private parts = new Map<string, Group>();
  private patterns = new Map<string, Texture>();
  private hidden = new Set<string>(["Other frames"]);
  private lens = new Box3();
  private look: Look = "all";
  private building = 0;

  constructor(private state: State) {
    const looks = ([["all", "Whole scene"], ["side", "Side"], ["top", "Top"], ["lens", "Lens"]] as const)
      .map(([look, name]) => h("button", { type: "button", onclick: () => this.aim(look) }, name));
    const layers = ["Rays", "Fields of view", "Other frames"].map((name) => toggle(name, "", !this.hidden.has(name), (on) => {
      if (on) this.hidden.delete(name);
      else this.hidden.add(name);
      this.parts.forEach((group, key) => { group.visible = !this.hidden.has(key); });
      this.draw();
    }));
    this.element = h("div", { class: "scene" },
      h("div", { class: "bar" }, h("div", { class: "zoom", role: "group", "aria-label": "Point of view" }, ...looks),
        h("div", { class: "toggles", role: "group", "aria-label": "Parts of the scene" }, ...layers)),
      this.box, this.note);
    whenSeen(this.element, () => this.begin());
    state.on(["camera", "frame", "theme"], () => void this.build());
  }

  private async begin(): Promise<void> {
    try {
      this.renderer = new WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
    } catch {
      this.note.textContent = "This browser has no WebGL, so there is no view in space.";
      return;
    }
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    this.box.append(this.renderer.domElement);
    this.controls = new OrbitControls(this.eye, this.renderer.domElement);
    this.controls.listenToKeyEvents(this.box);
    this.box.addEventListener("keydown", (event) => this.key(event));
    this.controls.addEventListener("change", () => this.draw());
    new ResizeObserver(() => this.resize()).observe(this.box);
    await this.build();
    this.aim("all");
  }

  /** Comes closer and goes away; the arrows are those of the controls. */
  private key(event: KeyboardEvent): void {
    const by = ({ "+": 0.8, "=": 0.8, "-": 1.25 } as Record<string, number>)[event.key];
    if (!by || !this.controls || event.ctrlKey || event.metaKey || event.altKey) return;
    this.eye.position.sub(this.controls.target).multiplyScalar(by).add(this.controls.target);
    this.controls.update();
    this.draw();
    event.preventDefault();
  }

  private async build(): Promise<void> {
    if (!this.renderer) return;
    const turn = ++this.building;
    const { camera, view, page } = this.state;
    this.scene.clear();
    this.parts.clear();
    this.scene.add(new AmbientLight("#ffffff", 1.5));
    const sun = new DirectionalLight("#ffffff", 1.6);
    sun.position.set(1, 2, 3);
    this.scene.add(sun);
    if (!view) return;
    const others = this.part("Other frames");
    const seen = new Set<string>();
    page.cameras.forEach((one) => {
      const at = one.views.find((other) => other.frame === view.frame);
      const body = one.name.split("@")[0];
      if (!at || seen.has(body)) return;
      seen.add(body);
      this.part("Fields of view").add(frustum(one, at, reach(view), one.name.split("@")[0] === camera.name.split("@")[0]));
    });
    for (const target of page.targets.filter((one) => one.picture)) {
      const pose = worldFromTarget(view, target.name), pattern = this.pattern(target);
      if (pose) this.scene.add(board(target, pattern, pose, 1));
      for (const other of camera.views) {
        const there = other !== view && worldFromTarget(other, target.name);
        if (there) others.add(board(target, pattern, there, 0.16));
      }
    }
    for (const one of page.cameras) {
      const at = one.views.find((other) => other.frame === view.frame);
      if (!at || !one.optics || (one.name.includes("@") && one !== camera)) continue;
      if (one !== camera && one.name.split("@")[0] === camera.name.split("@")[0]) continue;
      const optics = await load<Optics>(one.optics);
      if (turn !== this.building) return; // another frame was chosen meanwhile
      this.addLens(optics, at, one === camera);
    }
    this.parts.forEach((group, key) => { group.visible = !this.hidden.has(key); });
    const distances = Object.values(view.camera_from_target).map((pose) => `${Math.hypot(pose[0][3], pose[1][3], pose[2][3]).toFixed(1)} mm`);
    const words = `Frame ${view.frame}: ${page.targets.length} ${page.targets.length === 1 ? "target" : "targets"}, ${distances.join(", ")} from the centre of the stop.`;
    this.note.textContent = `${words} Drag to turn, scroll to come closer; by keys: Shift with arrows, + and −.`;
    this.box.setAttribute("aria-label", `View in space. ${words}`);
    this.draw();
  }

  private addLens(optics: Optics, view: View, isChosen: boolean): void {
    const group = new Group();
    group.applyMatrix4(worldFromCamera(view));
    group.add(...glasses(optics.surfaces), ...apertures(optics.surfaces), film(optics));
    this.scene.add(group);
    if (isChosen) {
      const rays = new Group();
      rays.applyMatrix4(worldFromCamera(view));
      optics.fans.forEach((fan, i) => rays.add(...fan.rays.map((ray) => strip(ray, FANS[i % FANS.length], 0.28))));
      this.part("Rays").add(rays);
      this.lens = new Box3().setFromObject(group);
    }
  }

  /** The picture of a target, which is drawn once it has been decoded. */
  private pattern(target: TargetPart): Texture {
    const pattern = this.patterns.get(target.name) ?? new TextureLoader().load(target.picture, () => this.draw());
    this.patterns.set(target.name, pattern);
    return pattern;
  }

  private part(name: string): Group {
    const group = this.parts.get(name) ?? new Group();
    this.parts.set(name, group);
    this.scene.add(group);
    return group;
  }

  private aim(look: Look): void {
    if (!this.controls || !this.state.view) return;
    this.look = look;
    const boards = new Box3();
    this.scene.traverse((one) => { if (one.userData.board) boards.expandByObject(one); });
    const box = look === "lens" ? this.lens.clone() : boards.union(this.lens);
    const pose = worldFromCamera(this.state.view);
    const turned = (x: number, y: number, z: number) => new Vector3(x, y, z).transformDirection(pose);
    // Vision frame: x right, y down, z forward.
    const way = { all: turned(-0.8, -0.4, -0.28), lens: turned(-0.9, -0.3, -0.25), side: turned(-1, 0, 0.0001), top: turned(0.0001, -1, -0.001) }[look];
    this.eye.up.copy(look === "top" ? turned(1, 0, 0) : turned(0, -1, 0));
    const middle = box.getCenter(new Vector3());
    const fit = distanceFor(box, middle, way, this.eye);
    this.eye.position.copy(middle).addScaledVector(way, fit);
    [this.eye.near, this.eye.far] = [fit / 500, fit * 20];
    this.controls.target.copy(middle);
    this.eye.updateProjectionMatrix();
    this.controls.update();
    this.draw();
  }

  private resize(): void {
    const [width, height] = [this.box.clientWidth, this.box.clientHeight];
    if (!width || !height) return;
    this.renderer!.setSize(width, height);
    this.eye.aspect = width / height;
    this.eye.updateProjectionMatrix();
    this.aim(this.look);
  }

  private draw(): void {
    this.renderer?.render(this.scene, this.eye);
  }
}

/** Distance from the middle of a box at which all of its corners are in the picture. */
function distanceFor(box: Box3, middle: Vector3, way: Vector3, eye: PerspectiveCamera): number {
  const right = new Vector3().crossVectors(eye.up, way).normalize();
  const up = new Vector3().crossVectors(way, right).normalize();
  const slope = 0.9 * Math.tan((eye.fov * Math.PI) / 360);
  const corners = [box.min, box.max];
  let far = 1;
  for (const x of corners) for (const y of corners) for (const z of corners) {
    const corner = new Vector3(x.x, y.y, z.z).sub(middle);
    const aside = Math.max(Math.abs(corner.dot(up)), Math.abs(corner.dot(right)) / eye.aspect);
    far = Math.max(far, aside / slope + corner.dot(way));
  }
  return far;
}

function matrix(rows: number[][]): Matrix4 {
  return new Matrix4().set(...(rows.flat() as Parameters<Matrix4["set"]>));
}

function worldFromCamera(view: View): Matrix4 {
  return matrix(view.camera_from_world).invert();
}

function worldFromTarget(view: View, target: string): Matrix4 | null {
  const pose = view.camera_from_target[target];
  return pose ? worldFromCamera(view).multiply(matrix(pose)) : null;
}

function reach(view: View): number {
  return Math.max(1, ...Object.values(view.camera_from_target).map((pose) => pose[2][3])) * 1.08;
}

function board(target: TargetPart, pattern: Texture, pose: Matrix4, opacity: number): Mesh {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(target.corners_mm.flat()), 3));
  geometry.setAttribute("uv", new BufferAttribute(new Float32Array(target.places.flat()), 2));
  geometry.setIndex(target.faces.flatMap(([a, b, c, d]) => [a, b, c, a, c, d]));
  const material = new MeshBasicMaterial({ color: "#efefef", map: pattern, side: DoubleSide, transparent: opacity < 1, opacity, depthWrite: opacity === 1 });
  const mesh = new Mesh(geometry, material);
  mesh.applyMatrix4(pose);
  if (opacity === 1) mesh.userData.board = true;
  return mesh;
}

function segments(points: number[][], tint: string, opacity: number): LineSegments {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(points.flat()), 3));
  return new LineSegments(geometry, new LineBasicMaterial({ color: tint, transparent: opacity < 1, opacity }));
}

function strip(points: number[][], tint: string, opacity: number): LineSegments {
  return segments(points.slice(1).flatMap((point, i) => [points[i], point]), tint, opacity);
}

function frustum(camera: CameraPart, view: View, length: number, isChosen: boolean): LineSegments {
  const [x, y] = [camera.width_px, camera.height_px].map((size) => (size / 2 / camera.principal_distance_px) * length);
  const corners = [[-x, -y, length], [x, -y, length], [x, y, length], [-x, y, length]];
  const lines = corners.flatMap((corner, i) => [[0, 0, 0], corner, corner, corners[(i + 1) % 4]]);
  const shown = segments(lines, colour(isChosen ? "accent" : "muted") || "#888888", isChosen ? 0.8 : 0.4);
  shown.applyMatrix4(worldFromCamera(view));
  return shown;
}

/** A body between each surface that glass follows and the next one: both profiles, turned about the axis. */
function glasses(surfaces: SurfaceShape[]): Mesh[] {
  return surfaces.flatMap((front, i) => {
    const back = surfaces[i + 1];
    if (!front.has_glass_behind || !back) return [];
    const around = (one: SurfaceShape) => one.height_mm.map((height, step) => new Vector2(Math.max(height, 1e-4), one.z_mm[step]));
    const geometry = new LatheGeometry([...around(front), ...around(back).reverse()], 64);
    geometry.rotateX(Math.PI / 2); // the axis of turning is y
    const glass = new MeshPhongMaterial({ color: "#6fb4e8", transparent: true, opacity: 0.34, side: DoubleSide, depthWrite: false, shininess: 90 });
    const mesh = new Mesh(geometry, glass);
    mesh.applyMatrix4(matrix(front.moved));
    return [mesh];
  });
}

/** A dark ring around the opening of the stop. */
function apertures(surfaces: SurfaceShape[]): Mesh[] {
  const widest = Math.max(...surfaces.map((one) => one.height_mm[one.height_mm.length - 1]));
  return surfaces.filter((one) => one.is_stop).map((stop) => {
    const inner = stop.height_mm[stop.height_mm.length - 1], z = stop.z_mm[0];
    const geometry = new LatheGeometry([new Vector2(inner, z), new Vector2(1.05 * Math.max(widest, inner), z)], 64);
    geometry.rotateX(Math.PI / 2);
    return new Mesh(geometry, new MeshBasicMaterial({ color: "#39424e", side: DoubleSide, transparent: true, opacity: 0.75 }));
  });
}

function film(optics: Optics): Mesh {
  const geometry = new BufferGeometry();
  const corners = [0, 1, 2, 0, 2, 3].flatMap((corner) => optics.sensor_mm[corner]);
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(corners), 3));
  return new Mesh(geometry, new MeshBasicMaterial({ color: "#8a63d2", side: DoubleSide }));
}
