// What is looked at: a camera, one of its frames, and the theme. Sections listen.

import type { CameraPart, Page, View } from "./records";

type Change = "camera" | "frame" | "theme";

/** The chosen camera and frame. */
export class State {
  private listeners: [Change[], () => void][] = [];
  private cameraAt = 0;
  private viewAt = 0;

  constructor(readonly page: Page) {}

  get camera(): CameraPart {
    return this.page.cameras[this.cameraAt];
  }

  get view(): View | undefined {
    return this.camera.views[this.viewAt];
  }

  /** Calls back after any of these changes. */
  on(changes: Change[], run: () => void): void {
    this.listeners.push([changes, run]);
  }

  chooseCamera(index: number): void {
    this.cameraAt = (index + this.page.cameras.length) % this.page.cameras.length;
    this.viewAt = Math.min(this.viewAt, Math.max(0, this.camera.views.length - 1));
    this.tell("camera");
  }

  chooseFrame(index: number): void {
    const views = this.camera.views.length;
    if (!views) return;
    this.viewAt = Math.min(Math.max(index, 0), views - 1);
    this.tell("frame");
  }

  step(cameras: number, frames: number): void {
    if (cameras) this.chooseCamera(this.cameraAt + cameras);
    if (frames) this.chooseFrame(this.viewAt + frames);
  }

  get frameIndex(): number {
    return this.viewAt;
  }

  get cameraIndex(): number {
    return this.cameraAt;
  }

  tell(change: Change): void {
    for (const [changes, run] of this.listeners) if (changes.includes(change)) run();
  }
}
