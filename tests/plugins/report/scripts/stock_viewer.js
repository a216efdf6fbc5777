// Another program's renderer: three.js opens a USDZ file that the page carries, and draws what its first camera sees.
import { AmbientLight, NoToneMapping, Scene, WebGLRenderer } from "three";
import { USDLoader } from "three/examples/jsm/loaders/USDLoader.js";

const bytes = Uint8Array.from(atob(window.USDZ), (one) => one.charCodeAt(0));
const [width, height] = window.SIZE;
new USDLoader().parse(bytes.buffer, "", (stage) => {
  stage.scale.setScalar(1); // the loader makes metres of units, but not of clipping planes
  const scene = new Scene();
  scene.add(stage, new AmbientLight("#ffffff", Math.PI));
  let eye = null;
  stage.traverse((one) => { if (one.isCamera) eye ??= one; });
  const renderer = new WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  renderer.toneMapping = NoToneMapping;
  renderer.setSize(width, height);
  document.body.append(renderer.domElement);
  eye.aspect = width / height;
  eye.updateProjectionMatrix();
  scene.updateMatrixWorld(true);
  const draw = () => renderer.render(scene, eye);
  setTimeout(draw, 500); // textures come later
  setTimeout(() => { draw(); document.documentElement.dataset.ready = "yes"; }, 1500);
});
