// Labels of bodies: a layer of HTML above the 3D view. Runs inside the viewer iframe.
//
// Labels that would overlap a more important one are left out: the near and the large come first. An id is shown faintly
// beside the text, if it says more than the text.

import { beforeFrames, fiberState, onNewConnection, onViewData, viewReady } from "./viewData.js";

const MAX_DRAWN = 60;
const MARGIN_PX = 8;
const HEIGHT_PX = 18;
const MAX_ID_CHARACTERS = 16;
const BEFORE_RENDERING = -1;

const layer = document.createElement("div");
layer.className = "mindstage-labels";
layer.setAttribute("aria-hidden", "true"); // the outliner has the same names in order
const ruler = document.createElement("canvas").getContext("2d");
const pool = [];
let labels = [];
let positions = new Float32Array();

function faintId(id, text) {
  if (id.toLowerCase().replaceAll(/[^a-z0-9]/g, "") === text.toLowerCase().replaceAll(/[^a-z0-9]/g, "")) return "";
  return id.length > MAX_ID_CHARACTERS ? `${id.slice(0, MAX_ID_CHARACTERS - 1)}…` : id;
}

function measure(label) {
  if (label.width === undefined) {
    ruler.font = "600 11px system-ui, sans-serif";
    label.width = 12 + ruler.measureText(label.text).width;
    ruler.font = "10px system-ui, sans-serif";
    label.width += label.faint ? 5 + ruler.measureText(label.faint).width : 0;
  }
  return label.width;
}

// Projects all labels to the canvas; those outside of it or above the clipping plane are left out.
function project(view, camera, { width, height }, clippingHeight) {
  const world = view.nodeRefFromName[""]?.matrixWorld;
  if (!world || positions.length !== 3 * labels.length) return [];
  const point = camera.position.clone();
  const visible = [];
  labels.forEach((label, row) => {
    point.fromArray(positions, 3 * row).applyMatrix4(world);
    if (point.y > clippingHeight) return;
    const distance = point.distanceTo(camera.position);
    point.applyMatrix4(camera.matrixWorldInverse);
    if (point.z > -camera.near) return; // behind the camera
    point.applyMatrix4(camera.projectionMatrix);
    if (Math.abs(point.x) > 1 || Math.abs(point.y) > 1) return;
    const importance = (0.3 + Math.min(label.size, 1.5)) / Math.max(distance, 0.1) ** 1.5;
    visible.push({ label, importance, x: ((point.x + 1) / 2) * width, y: ((1 - point.y) / 2) * height });
  });
  return visible.sort((one, other) => other.importance - one.importance);
}

// Chooses labels in the order of their importance that do not overlap those chosen before.
function choose(candidates) {
  const chosen = [];
  for (const candidate of candidates) {
    if (chosen.length >= MAX_DRAWN) break;
    const half = measure(candidate.label) / 2 + MARGIN_PX;
    const isFree = chosen.every((other) => Math.abs(other.x - candidate.x) >= half + other.half || Math.abs(other.y - candidate.y) >= HEIGHT_PX + MARGIN_PX);
    if (isFree) chosen.push({ ...candidate, half });
  }
  return chosen;
}

function element(index) {
  if (!pool[index]) {
    pool[index] = document.createElement("div");
    pool[index].className = "mindstage-label";
    pool[index].append(document.createElement("b"), document.createElement("i"));
    layer.append(pool[index]);
  }
  return pool[index];
}

function draw(view) {
  if (labels.length === 0 && pool.length === 0) return;
  const { camera, size, gl } = fiberState(view);
  camera.updateMatrixWorld();
  const shown = choose(project(view, camera, size, gl.clippingPlanes[0]?.constant ?? Infinity));
  shown.forEach(({ label, x, y }, index) => {
    const node = element(index);
    const [text, faint] = node.children;
    if (text.textContent !== label.text) text.textContent = label.text;
    if (faint.textContent !== label.faint) faint.textContent = label.faint;
    node.hidden = false;
    node.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -100%)`;
  });
  for (let index = shown.length; index < pool.length; index++) pool[index].hidden = true;
}

onNewConnection(() => {
  labels = [];
});
onViewData("labels", (_, { ids, texts, sizes, positions: moved }) => {
  if (ids) labels = ids.map((id, row) => ({ text: texts[row], faint: faintId(id, texts[row]), size: sizes[row] }));
  if (moved) positions = moved;
});

viewReady.then((view) => {
  view.canvas.closest("div").append(layer);
  beforeFrames(view, BEFORE_RENDERING, () => draw(view));
});
