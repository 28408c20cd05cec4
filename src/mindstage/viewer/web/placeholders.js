// Placeholders: boxes in the place of bodies whose meshes have not arrived yet. Runs inside the viewer iframe.
//
// The server sends the boxes of all bodies in the first message, the meshes follow, large ones first. A box is removed in
// the frame in which the mesh of its body is there. A view without the page says how far it is, otherwise the page does.

import { applyPoses } from "./bodyPoses.js";
import { beforeFrames, geometryClass, onNewConnection, onReplayDone, onViewData, reportMissing, viewReady } from "./viewData.js";

const BEFORE_RENDERING = -5;
const SHOW_PROGRESS_MS = 1500;
const LOST_MS = 60_000; // after this time without a mesh, a body without a node was removed
const POSE_LENGTH = 7;
const BATCHES = "/batches/";
const ALL_FACES = -1;
const CORNERS = [[-1, -1], [1, -1], [1, 1], [-1, 1]];
const VERTEX_SHADER = `
attribute vec3 color;
varying vec3 vColor;
void main() {
  vec3 up = normalize(mat3(modelMatrix) * normal);
  vColor = color * (0.74 + 0.2 * up.y + 0.06 * up.x); // light from above
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;
const FRAGMENT_SHADER = `
varying vec3 vColor;
void main() {
  gl_FragColor = vec4(vColor, 1.0);
}`;

const progress = document.createElement("div");
progress.className = "mindstage-loading";
progress.setAttribute("role", "status");
progress.hidden = true;

// The corners, normals and colors of boxes; a box may have one face only, that of a wall towards the room.
function faces({ poses, sizes, colors, sides }) {
  const corners = { position: [], normal: [], color: [], index: [], ends: [] };
  for (let box = 0; box < sides.length; box++) {
    const [px, py, pz, w, x, y, z] = poses.subarray(box * POSE_LENGTH, (box + 1) * POSE_LENGTH);
    const rotation = [
      [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
      [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
      [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ];
    const rotated = (vector) => rotation.map((row) => row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2]);
    for (let face = 0; face < 6; face++) {
      if (sides[box] !== ALL_FACES && sides[box] !== face) continue;
      const axis = face >> 1;
      const sign = face & 1 ? 1 : -1;
      const normal = [0, 0, 0];
      normal[axis] = sign;
      const first = corners.position.length / 3;
      for (const [u, v] of CORNERS) {
        const local = [0, 0, 0];
        local[axis] = sign * sizes[3 * box + axis] / 2;
        local[(axis + 1) % 3] = sign * u * sizes[3 * box + (axis + 1) % 3] / 2;
        local[(axis + 2) % 3] = v * sizes[3 * box + (axis + 2) % 3] / 2;
        const [dx, dy, dz] = rotated(local);
        corners.position.push(px + dx, py + dy, pz + dz);
        corners.normal.push(...rotated(normal));
        corners.color.push(colors[3 * box] / 255, colors[3 * box + 1] / 255, colors[3 * box + 2] / 255);
      }
      corners.index.push(first, first + 1, first + 2, first, first + 2, first + 3);
    }
    corners.ends.push(corners.position.length);
  }
  return corners;
}

class Placeholders {
  #view;
  #boxes = null; // as the server has sent them
  #mesh = null;
  #pending = new Map(); // the numbers of the boxes by the name of their node
  #ends = [];
  #count = 0;
  #startMs = 0;
  #progressMs = 0;
  #isReplayDone = false;

  constructor(view) {
    this.#view = view;
  }

  reset() {
    this.#removeMesh();
    this.#boxes = null;
    this.#pending.clear();
    this.#isReplayDone = false;
    reportMissing(0, 0);
    progress.hidden = true;
  }

  show(boxes) {
    if (!boxes.names || (this.#isReplayDone && this.#boxes)) return; // bodies that are added later have their meshes at once
    this.reset();
    this.#boxes = boxes;
    // The poses of nodes follow after all meshes. Batches have no poses, but their instances.
    applyPoses({ names: boxes.names.map((name) => (name.startsWith(BATCHES) ? "" : name)), poses: boxes.poses });
    this.#count = boxes.names.length;
    this.#startMs = this.#progressMs = performance.now();
    boxes.names.forEach((name, box) => this.#pending.set(name, [...(this.#pending.get(name) ?? []), box]));
  }

  replayDone() {
    this.#isReplayDone = true;
  }

  update() {
    if (!this.#boxes || !this.#view.nodeRefFromName[""]) return;
    if (!this.#mesh && this.#pending.size) this.#build();
    let changed = false;
    for (const [name, boxes] of this.#pending) {
      if (!this.#isLoaded(name) && !this.#isGone(name)) continue;
      this.#pending.delete(name);
      for (const box of boxes) this.#mesh?.geometry.attributes.position.array.fill(0, box ? this.#ends[box - 1] : 0, this.#ends[box]);
      changed = true;
    }
    if (changed) this.#progressMs = performance.now();
    if (changed && this.#mesh) this.#mesh.geometry.attributes.position.needsUpdate = true;
    if (!this.#pending.size) this.#removeMesh();
    this.#showProgress();
  }

  #isLoaded(name) {
    const node = this.#view.nodeRefFromName[name];
    return Boolean(node?.children.some((child) => child.children.length));
  }

  // Whether a body was removed before its mesh arrived.
  #isGone(name) {
    return (this.#isReplayDone || performance.now() - this.#progressMs > LOST_MS) && !window.__viserSceneTree?.getState()[name]?.message;
  }

  #build() {
    const background = this.#view.backgroundMaterial;
    let quad = null;
    this.#view.scene.traverse((node) => {
      if (node.material === background) quad = node;
    });
    if (!quad) return;
    const { position, normal, color, index, ends } = faces(this.#boxes);
    const Attribute = quad.geometry.attributes.position.constructor;
    const Geometry = geometryClass(quad.geometry);
    const geometry = new Geometry();
    for (const [name, values] of Object.entries({ position, normal, color })) geometry.setAttribute(name, new Attribute(new Float32Array(values), 3));
    geometry.setIndex(index);
    const material = new background.constructor({ vertexShader: VERTEX_SHADER, fragmentShader: FRAGMENT_SHADER });
    this.#mesh = new quad.constructor(geometry, material);
    this.#mesh.frustumCulled = false;
    this.#mesh.raycast = () => {};
    this.#ends = ends;
    this.#view.nodeRefFromName[""].add(this.#mesh);
  }

  #removeMesh() {
    this.#mesh?.removeFromParent();
    this.#mesh?.geometry.dispose();
    this.#mesh?.material.dispose();
    this.#mesh = null;
  }

  #showProgress() {
    let left = 0;
    for (const boxes of this.#pending.values()) left += boxes.length;
    reportMissing(left, this.#count);
    progress.hidden = parent !== window || left === 0 || performance.now() - this.#startMs < SHOW_PROGRESS_MS;
    const text = `Loading shapes: ${this.#count - left} of ${this.#count}`;
    if (!progress.hidden && progress.textContent !== text) progress.textContent = text;
  }

  // How many bodies have their meshes, and how many there are; for tests.
  get state() {
    let left = 0;
    for (const boxes of this.#pending.values()) left += boxes.length;
    return { count: this.#count, loaded: this.#count - left, isDrawn: this.#mesh !== null };
  }
}

viewReady.then((view) => {
  const placeholders = new Placeholders(view);
  view.canvas.closest("div").append(progress);
  onNewConnection(() => placeholders.reset());
  onViewData("boxes", (_, boxes) => placeholders.show(boxes));
  onReplayDone(() => placeholders.replayDone());
  beforeFrames(view, BEFORE_RENDERING, () => placeholders.update());
  window.mindstageView = { ...window.mindstageView, placeholders };
});
