// Levels of detail: draws far and small meshes with fewer triangles, and none that are smaller than a pixel. Runs inside
// the viewer iframe.
//
// A level clusters vertices on a grid (Rossignac and Borrel, "Multi-resolution 3D approximations", 1993): those in one
// cell become one vertex, and triangles within a cell vanish. Unlike the simplification of viser it needs no connected
// triangles, which meshes with sharp edges do not have. A level is used from where a cell is smaller than a pixel, so
// that the picture is the same.

import { beforeFrames, fiberState, geometryClass, viewReady } from "./viewData.js";

const BEFORE_RENDERING = -3.7; // before sunShadow.js, since shadows are drawn of the same levels
const CELLS = [16, 8, 4, 2]; // cells along the longest side of a mesh, of each level
const MIN_CELLS = 2; // along the other sides, since a mesh of one layer of cells would have no triangles
const MAX_CELL_PX = 0.8; // what is thinner than a cell, such as a handle, vanishes
const MIN_SIZE_PX = 1;
const MIN_TRIANGLES = 64;
const WORTHWHILE = 0.6; // share of the triangles of the next finer level
const BUILDING_MS = 40; // in a frame

// -- simplification -------------------------------------------------------------------------------------------------

const isPlain = (attribute) => !attribute.isInterleavedBufferAttribute && attribute.array instanceof Float32Array;
const isSimplifiable = ({ index, attributes: { position, normal, uv }, morphAttributes }) =>
  index && normal && [position, normal, uv].every((each) => !each || isPlain(each)) && !Object.keys(morphAttributes).length;

// The cell of each vertex, and the mean position of the vertices in each cell.
function clusterVertices({ attributes, boundingBox }, cellsAlong) {
  const { array: points, count } = attributes.position;
  const low = boundingBox.min.toArray();
  const extent = boundingBox.max.toArray().map((high, axis) => Math.max(high - low[axis], 1e-9));
  const cells = extent.map((each) => Math.max(MIN_CELLS, Math.round((cellsAlong * each) / Math.max(...extent))));
  const sums = new Float64Array(4 * cells[0] * cells[1] * cells[2]);
  const cellOf = new Uint32Array(count);
  for (let vertex = 0; vertex < count; vertex++) {
    let cell = 0;
    for (let axis = 0; axis < 3; axis++) {
      const at = Math.floor((cells[axis] * (points[3 * vertex + axis] - low[axis])) / extent[axis]);
      cell = cell * cells[axis] + Math.min(Math.max(at, 0), cells[axis] - 1);
    }
    cellOf[vertex] = cell;
    for (let axis = 0; axis < 3; axis++) sums[4 * cell + axis] += points[3 * vertex + axis];
    sums[4 * cell + 3] += 1;
  }
  return { cellOf, sums };
}

// The axis and the sign of the largest component of a normal: edges stay sharp between vertices of different sides.
function sideOf(normals, vertex) {
  const [x, y, z] = [normals[3 * vertex], normals[3 * vertex + 1], normals[3 * vertex + 2]];
  const axis = Math.abs(x) >= Math.abs(y) && Math.abs(x) >= Math.abs(z) ? 0 : Math.abs(y) >= Math.abs(z) ? 1 : 2;
  return 2 * axis + ([x, y, z][axis] > 0 ? 1 : 0);
}

// A geometry with so many cells along its longest side, or null if it would have no triangles.
function simplified(geometry, cellsAlong) {
  const { normal, uv } = geometry.attributes;
  const { cellOf, sums } = clusterVertices(geometry, cellsAlong);
  const index = geometry.index.array;
  const added = { position: [], normal: [], uv: [] };
  const [corners, groups] = [[], []];
  const parts = geometry.groups.length ? geometry.groups : [{ start: 0, count: index.length, materialIndex: 0 }];
  for (const { start, count, materialIndex } of parts) {
    const vertexOf = new Map();
    const seen = new Set();
    const first = corners.length;
    const clustered = (vertex) => {
      const key = 6 * cellOf[vertex] + sideOf(normal.array, vertex);
      let number = vertexOf.get(key);
      if (number === undefined) {
        number = added.position.length / 3;
        vertexOf.set(key, number);
        for (let axis = 0; axis < 3; axis++) added.position.push(sums[4 * cellOf[vertex] + axis] / sums[4 * cellOf[vertex] + 3]);
        added.normal.push(0, 0, 0);
        if (uv) added.uv.push(uv.array[2 * vertex], uv.array[2 * vertex + 1]);
      }
      for (let axis = 0; axis < 3; axis++) added.normal[3 * number + axis] += normal.array[3 * vertex + axis];
      return number;
    };
    for (let corner = start; corner < Math.min(start + count, index.length); corner += 3) {
      const [a, b, c] = [index[corner], index[corner + 1], index[corner + 2]];
      if (cellOf[a] === cellOf[b] || cellOf[b] === cellOf[c] || cellOf[c] === cellOf[a]) continue;
      const triangle = [clustered(a), clustered(b), clustered(c)];
      const smallest = triangle.indexOf(Math.min(...triangle));
      const key = [0, 1, 2].map((each) => triangle[(smallest + each) % 3]).join();
      if (seen.has(key)) continue;
      seen.add(key);
      corners.push(...triangle);
    }
    groups.push({ start: first, count: corners.length - first, materialIndex });
  }
  if (!corners.length) return null;
  for (let vertex = 0; vertex < added.normal.length; vertex += 3) {
    const length = Math.hypot(added.normal[vertex], added.normal[vertex + 1], added.normal[vertex + 2]) || 1;
    for (let axis = 0; axis < 3; axis++) added.normal[vertex + axis] /= length;
  }
  const Geometry = geometryClass(geometry);
  const result = new Geometry();
  const Attribute = geometry.attributes.position.constructor;
  for (const [name, values] of Object.entries(added)) if (values.length) result.setAttribute(name, new Attribute(new Float32Array(values), name === "uv" ? 2 : 3));
  result.setIndex(corners);
  if (geometry.groups.length) for (const group of groups) result.addGroup(group.start, group.count, group.materialIndex);
  return result;
}

// The levels of one geometry, built when they are needed.
class Levels {
  #full;
  #built = new Map();

  constructor(full) {
    this.#full = full;
    full.boundingBox ?? full.computeBoundingBox();
    full.boundingSphere ?? full.computeBoundingSphere();
    const size = full.boundingBox.max.clone().sub(full.boundingBox.min);
    this.longest = Math.max(size.x, size.y, size.z);
    this.sphere = full.boundingSphere;
    this.canSimplify = full.index?.count >= 3 * MIN_TRIANGLES && isSimplifiable(full);
    full.addEventListener("dispose", () => this.#built.forEach((each) => each !== full && each.dispose()));
  }

  // The distance of the nearest point from which a level is used, for the angle of a pixel [rad].
  distance(level, pixel) {
    return level === CELLS.length ? this.longest / (MIN_SIZE_PX * pixel) : this.longest / (MAX_CELL_PX * CELLS[level] * pixel);
  }

  // The geometry of a level, -1 for that of the mesh itself; a level with hardly fewer triangles is the next finer one.
  geometry(level) {
    if (level < 0 || !this.canSimplify) return this.#full;
    if (!this.#built.has(level)) {
      const coarse = simplified(this.#full, CELLS[level]);
      const finer = this.#built.get(level - 1) ?? this.#full;
      this.#built.set(level, coarse && coarse.index.count <= WORTHWHILE * finer.index.count ? coarse : finer);
    }
    return this.#built.get(level);
  }

  isBuilt(level) {
    return level < 0 || !this.canSimplify || this.#built.has(level);
  }
}

// -- meshes ---------------------------------------------------------------------------------------------------------

// A batch has a mesh for each level, among which three.ez/instanced-mesh distributes the instances by their distance.
class BatchLevels {
  #mesh;
  #levels;
  #used = []; // the numbers of the levels that the mesh has, after the first
  #pixel = 0;

  constructor(mesh, levels) {
    [this.#mesh, this.#levels] = [mesh, levels];
    const own = [mesh.geometry];
    for (let level = 0; level < CELLS.length; level++) {
      const geometry = levels.geometry(level);
      if (own.includes(geometry)) continue;
      own.push(geometry);
      this.#add(level, geometry);
    }
    const Geometry = geometryClass(mesh.geometry);
    this.#add(CELLS.length, new Geometry()).visible = false;
  }

  get isCurrent() {
    return true; // viser creates another batch for another geometry
  }

  // Returns whether the level is built.
  update({ pixel }) {
    const { objects } = this.#mesh.LODinfo;
    const { castShadow, receiveShadow } = this.#mesh;
    for (const each of objects) if (each !== this.#mesh) Object.assign(each, { castShadow, receiveShadow });
    if (pixel === this.#pixel) return true;
    this.#pixel = pixel;
    const { center, radius } = this.#levels.sphere;
    this.#mesh.updateAllLOD(this.#used.map((level) => this.#levels.distance(level, pixel) + radius + center.length()));
    return true;
  }

  #add(level, geometry) {
    const { material } = this.#mesh;
    const copies = Array.isArray(material) ? material.map((each) => each.clone()) : material.clone();
    this.#mesh.addLOD(geometry, copies, level + 1); // the distance is set before the next frame
    this.#mesh.geometry.addEventListener("dispose", () => [copies].flat().forEach((each) => each.dispose()));
    this.#used.push(level);
    return this.#mesh.LODinfo.render.levels.at(-1).object;
  }
}

// A single mesh has one of the geometries at a time.
class MeshLevels {
  #mesh;
  #levels;
  #geometry;
  #level = -1;

  constructor(mesh, levels) {
    [this.#mesh, this.#levels, this.#geometry] = [mesh, levels, mesh.geometry];
  }

  // Whether viser has not replaced the geometry.
  get isCurrent() {
    return this.#mesh.geometry === this.#geometry;
  }

  update({ eye, pixel, mayBuild }) {
    const mesh = this.#mesh;
    const matrix = mesh.matrixWorld.elements;
    const { center, radius } = this.#levels.sphere;
    const from = [0, 1, 2].map((row) => matrix[row] * center.x + matrix[4 + row] * center.y + matrix[8 + row] * center.z + matrix[12 + row]);
    const scale = Math.hypot(matrix[0], matrix[1], matrix[2]);
    const distance = Math.hypot(from[0] - eye.x, from[1] - eye.y, from[2] - eye.z) / scale - radius;
    let level = -1;
    while (level < CELLS.length && distance >= this.#levels.distance(level + 1, pixel)) level += 1;
    if (level === this.#level) return true;
    if (level < CELLS.length) {
      if (!this.#levels.isBuilt(level) && !mayBuild()) return false;
      mesh.geometry = this.#geometry = this.#levels.geometry(level);
    }
    mesh.visible = level < CELLS.length;
    this.#level = level;
    return true;
  }
}

class LevelsOfDetail {
  #view;
  #known = new WeakMap(); // the levels of geometries
  #meshes = new Map();

  constructor(view) {
    this.#view = view;
  }

  update() {
    const { gl, size, camera } = fiberState(this.#view);
    const pixel = (2 * Math.tan((camera.fov * Math.PI) / 360)) / (size.height * gl.getPixelRatio() * camera.zoom);
    const end = performance.now() + BUILDING_MS;
    const choice = { eye: camera.position, pixel, mayBuild: () => performance.now() < end };
    this.#find();
    let isComplete = true;
    for (const each of this.#meshes.values()) isComplete = each.update(choice) && isComplete;
    if (!isComplete) this.#view.requestRender();
  }

  #find() {
    const found = new Map();
    this.#view.scene.traverse((mesh) => {
      if (!mesh.isMesh || mesh.isSkinnedMesh || mesh._parentLOD || ![mesh.material].flat().every((each) => each?.isMeshStandardMaterial)) return;
      const known = this.#meshes.get(mesh);
      found.set(mesh, known?.isCurrent ? known : this.#levelsOf(mesh));
    });
    this.#meshes = found;
  }

  #levelsOf(mesh) {
    if (!this.#known.has(mesh.geometry)) this.#known.set(mesh.geometry, new Levels(mesh.geometry));
    const levels = this.#known.get(mesh.geometry);
    return mesh.addLOD ? new BatchLevels(mesh, levels) : new MeshLevels(mesh, levels);
  }
}

viewReady.then((view) => {
  const levelsOfDetail = new LevelsOfDetail(view);
  beforeFrames(view, BEFORE_RENDERING, () => levelsOfDetail.update());
  window.mindstageView = { ...window.mindstageView, levelsOfDetail };
});
