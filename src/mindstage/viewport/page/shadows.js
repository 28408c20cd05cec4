// Shadows: keeps thin boards from casting a pattern of shadows on themselves.
//
// The sun's shadows are as coarse as some centimetres, which is thicker than many a cupboard's top. So where a surface
// looks up what shades it, it looks a little off itself.

const OFF_ITSELF_M = 0.03;

function look() {
  const view = window.__viserMutable;
  let changed = false;
  view?.scene?.traverse((node) => {
    if (node.isDirectionalLight && node.castShadow && node.shadow.normalBias !== OFF_ITSELF_M) {
      node.shadow.normalBias = OFF_ITSELF_M;
      changed = true;
    }
  });
  if (changed) view.requestRender();
  setTimeout(look, 500);
}

look();
