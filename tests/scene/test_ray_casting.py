"""Rays against MuJoCo's, visibility, and the volumes that shapes retain."""

from __future__ import annotations

import numpy as np
import pytest
from tests.engines.scenes import body

from mindstage.scene import NO_GEOMETRY, BodyGeometry, CollisionShape, CollisionShapeType, Pose
from mindstage.scene.proximity import BodyBoxes
from mindstage.scene.ray_casting import ShapeScene, retained_volume
from mindstage.scene.transforms import normalize

TYPES = (CollisionShapeType.BOX, CollisionShapeType.SPHERE, CollisionShapeType.CYLINDER)
CORNERS = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]


def shapes(*parts: CollisionShape, key: str = "shape") -> BodyGeometry:
    return BodyGeometry(key=key, visuals=(), collision_shapes=parts)


def random_shapes(seed: int, count: int) -> list[tuple[CollisionShapeType, np.ndarray, np.ndarray, np.ndarray]]:
    random = np.random.default_rng(seed)
    found = []
    for at in range(count):
        size = random.uniform(0.1, 1.0, 3)
        if TYPES[at % 3] is CollisionShapeType.CYLINDER:
            size[1] = size[0]
        found.append((TYPES[at % 3], size, random.uniform(-2, 2, 3), normalize(random.normal(size=4))))
    return found


def test_rays_hit_what_mujoco_s_rays_hit() -> None:
    mujoco = pytest.importorskip("mujoco")
    random, bodies, geometry, parts = np.random.default_rng(5), [], {}, []
    names = {TYPES[0]: "box", TYPES[1]: "ellipsoid", TYPES[2]: "cylinder"}
    for at, (kind, size, position, quaternion) in enumerate(random_shapes(3, 60)):
        each = body(f"b{at}", tuple(position), tuple(size), quaternion=tuple(quaternion))
        bodies.append(each)
        geometry[each.id] = shapes(CollisionShape(type=kind, size=tuple(size)), key=str(at))
        extents = f"{size[0] / 2} {size[2] / 2}" if kind is TYPES[2] else " ".join(map(str, size / 2))
        place = f'pos="{" ".join(map(str, position))}" quat="{" ".join(map(str, quaternion))}"'
        parts.append(f'<geom type="{names[kind]}" size="{extents}" {place}/>')
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{''.join(parts)}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = ShapeScene(bodies, geometry)
    origin, directions = np.array([0.1, 2.2, 0.2]), normalize(random.normal(size=(500, 4)))[:, :3]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    distance, row = scene.first_hits(origin, directions, np.full(500, 100.0), np.zeros(60, dtype=bool))
    expected, geom = [], np.zeros(1, dtype=np.int32)
    hits = []
    for each in directions:
        expected.append(mujoco.mj_ray(model, data, origin, each, None, 1, -1, geom, None))
        hits.append(int(geom[0]))
    assert sum(hit >= 0 for hit in hits) > 50
    assert row.tolist() == hits
    assert np.where(np.isfinite(distance), distance, -1.0) == pytest.approx(expected, abs=1e-6)


def test_visibility_is_the_fraction_of_sample_points_that_single_rays_see() -> None:
    random = np.random.default_rng(11)
    bodies = [
        body(f"b{at}", tuple(position), tuple(size), quaternion=tuple(quaternion))
        for at, (_, size, position, quaternion) in enumerate(random_shapes(9, 50))
    ]
    scene = ShapeScene(bodies, NO_GEOMETRY)
    origin = np.array([0.0, 0.0, 4.0]) + random.uniform(-0.1, 0.1, 3)
    found = scene.visibility(origin, range(50), np.zeros(50, dtype=bool))
    assert [each.row for each in found] == list(range(50))
    assert sum(0.0 < each.share < 1.0 for each in found) > 5
    for each in found[::5]:
        points, owners = scene.sample_points([each.row])
        assert set(owners.tolist()) == {each.row}
        seen = 0
        for point in points:  # one ray at a time, each with its own tree
            offset = point - origin
            length = np.linalg.norm(offset)
            _, row = scene.first_hits(origin, offset[None] / length, np.array([length]), np.zeros(50, dtype=bool))
            seen += int(row[0] == each.row)
        assert each.share == pytest.approx(seen / len(points))
        assert bool(each.hidden_by) == (each.share < 1.0)


def test_wide_narrow_and_compound_bodies_hide_as_in_a_search_through_all_rays() -> None:
    random, bodies, geometry = np.random.default_rng(4), [body("floor", (0.0, 0.0, -0.5), (40.0, 40.0, 0.1))], {}
    for at in range(160):
        position, quaternion = random.uniform((-8, -8, 0), (8, 8, 2)), normalize(random.normal(size=4))
        bodies.append(
            body(f"b{at}", tuple(position), tuple(random.uniform(0.05, 1.5, 3)), quaternion=tuple(quaternion))
        )
        if at % 3 == 0:
            parts = (CollisionShape(size=(0.1, 0.8, 0.8), pose=Pose((x, 0.0, 0.0))) for x in (-0.4, 0.4))
            geometry[bodies[-1].id] = shapes(*parts, key=str(at))
    scene, count = ShapeScene(bodies, geometry), len(bodies)
    origin, skipped = np.array([0.2, -0.1, 1.3]), np.zeros(count, dtype=bool)
    skipped[[5, 9]] = True
    found = {each.row: each for each in scene.visibility(origin, range(count), skipped)}
    boxes, hiders = scene.shape_boxes, set()
    for row in range(0, count, 8):
        points, _ = scene.sample_points([row])
        ray = points - origin
        start = np.einsum("sji,sj->si", boxes.rotation, origin - boxes.center)[:, None]
        along = np.einsum("sji,nj->sni", boxes.rotation, ray)
        ends = np.stack([(side * boxes.half_extents[:, None] - start) / along for side in (-1.0, 1.0)])
        near, far = ends.min(axis=0).max(axis=2), ends.max(axis=0).min(axis=2)
        hit = np.where((near <= far) & (far >= 0.0), np.maximum(near, 0.0), np.inf) * np.linalg.norm(ray, axis=1)
        own = np.minimum(hit[scene.owner == row].min(axis=0), np.linalg.norm(ray, axis=1))
        others = np.flatnonzero((scene.owner != row) & ~skipped[scene.owner])
        first = hit[others].min(axis=0)
        hidden = first <= own - 1e-6
        by = {int(scene.owner[others[at]]) for at in hit[others].argmin(axis=0)[hidden]}
        assert found[row].share == pytest.approx(1.0 - hidden.mean()), row
        assert set(found[row].hidden_by) == by, row
        hiders |= by
    assert len(hiders) > 5


def test_a_wall_hides_the_half_that_is_behind_it() -> None:
    scene = ShapeScene(
        [
            body("thing", (2.0, 0.0, 0.0), (0.2, 1.0, 1.0)),
            body("wall", (1.0, 1.0, 0.0), (0.01, 2.0, 4.0)),
            body("far", (3.0, 0.0, 0.0), (0.1, 9.0, 9.0)),
        ],
        NO_GEOMETRY,
    )
    (thing,) = scene.visibility(np.zeros(3), [0], np.zeros(3, dtype=bool))
    assert thing.share == pytest.approx(0.5, abs=0.06)
    assert thing.hidden_by == (1,)
    (thing,) = scene.visibility(np.zeros(3), [0], np.array([False, True, False]))
    assert (thing.share, thing.hidden_by) == (1.0, ())


def test_a_hull_is_hit_as_the_box_that_it_is() -> None:
    quaternion = tuple(normalize([0.9, 0.1, -0.3, 0.2]).tolist())
    each = body("cube", (0.3, -0.2, 0.1), (1.0, 1.0, 1.0), quaternion=quaternion)
    hull = shapes(CollisionShape(type=CollisionShapeType.HULL, size=(1.0, 1.0, 1.0), points=tuple(CORNERS)))
    rays = np.random.default_rng(2).normal(size=(300, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    arguments = (np.array([0.0, 2.0, 0.0]), rays, np.full(300, 10.0), np.zeros(1, dtype=bool))
    found, expected = (ShapeScene([each], geometry).first_hits(*arguments)[0] for geometry in ({each.id: hull}, {}))
    assert np.isfinite(found).any()
    assert np.nan_to_num(found, posinf=-1) == pytest.approx(np.nan_to_num(expected, posinf=-1), abs=1e-6)
    height = ShapeScene([each], {each.id: hull}).top_heights(0, np.array([0.3]), np.array([-0.2]))
    assert height == pytest.approx(ShapeScene([each], {}).top_heights(0, np.array([0.3]), np.array([-0.2])))


def tray(*, notch: bool) -> BodyGeometry:
    """An open box of 1 x 1 x 0.5 m with walls of 0.05 m; with a notch in one wall down to half of the height."""

    def part(center: tuple[float, float, float], size: tuple[float, float, float]) -> CollisionShape:
        return CollisionShape(size=size, pose=Pose(center))

    sides = [
        part((0, 0, -0.225), (1, 1, 0.05)),
        part((-0.475, 0, 0), (0.05, 1, 0.5)),
        part((0.475, 0, 0), (0.05, 1, 0.5)),
    ]
    sides.append(part((0, -0.475, 0), (1, 0.05, 0.5)))
    sides.append(part((0, 0.475, -0.125), (1, 0.05, 0.25)) if notch else part((0, 0.475, 0), (1, 0.05, 0.5)))
    return shapes(*sides)


@pytest.mark.parametrize(("notch", "depth"), [(False, 0.45), (True, 0.2)])
def test_a_tray_retains_its_volume_up_to_the_lowest_rim(notch: bool, depth: float) -> None:
    each = body("tray", (3.0, 1.0, 2.0), (1.0, 1.0, 0.5))
    placed = BodyBoxes.from_bodies([each])
    volume = retained_volume(ShapeScene([each], {each.id: tray(notch=notch)}), 0, placed.low[0], placed.high[0])
    assert volume == pytest.approx(0.9 * 0.9 * depth, rel=0.06)
    upside_down = body("tray", (3.0, 1.0, 2.0), (1.0, 1.0, 0.5), quaternion=(0.0, 1.0, 0.0, 0.0))
    scene = ShapeScene([upside_down], {each.id: tray(notch=notch)})
    assert retained_volume(scene, 0, placed.low[0], placed.high[0]) == pytest.approx(0.0, abs=1e-9)
