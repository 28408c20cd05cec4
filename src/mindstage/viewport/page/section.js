// Section: hides all that is above a height, so that one sees into rooms.
//
// The height comes as the place of a node that only this visitor's scene has. The cut is made by the browser's own
// clipping, exactly, and what is cut away does not catch the mouse either.

const NODE = "/section";
let cut = null; // how high, in metres; null where nothing is cut
let tamed = null; // the caster of rays that knows of the cut

function height(view) {
  const pose = view.nodePoseData[NODE];
  return pose && view.nodeRefFromName[NODE] ? pose.position[2] : null;
}

function state(view) {
  return view.scene?.__r3f?.root?.getState();
}

/** Rays pass through what is not drawn. The picture's y is the world's z. */
function tame(raycaster) {
  if (raycaster === tamed) return;
  for (const name of ["intersectObject", "intersectObjects"]) {
    const cast = raycaster[name].bind(raycaster);
    raycaster[name] = (...what) => {
      const hits = cast(...what);
      if (cut !== null) {
        const kept = hits.filter((hit) => hit.point.y <= cut);
        hits.length = 0;
        hits.push(...kept);
      }
      return hits;
    };
  }
  tamed = raycaster;
}

function look() {
  const view = window.__viserMutable;
  const three = view && state(view);
  if (three) {
    tame(three.raycaster);
    const wanted = height(view);
    if (wanted !== cut) {
      cut = wanted;
      three.gl.clippingPlanes = cut === null ? [] : [{ normal: { x: 0, y: -1, z: 0 }, constant: cut }];
      view.requestRender();
    }
  }
  setTimeout(look, 100);
}

look();
