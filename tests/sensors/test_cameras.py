"""Cameras: where OpenCV and ray casting by trimesh see things, what labels stand for, noise, and what is refused."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import mindstage as ms
from mindstage.engines import NullEngine
from mindstage.errors import BodyNotFoundError, InvalidArgumentError, NameNotFoundError, RendererUnavailableError
from mindstage.knowledge import KnowledgeBase
from mindstage.rendering import gl_context
from mindstage.scene import Body, BodyGeometry, BodyId, GeometrySource, Iri, PbrMaterial, Pose, VisualMesh, World
from mindstage.scene.mesh import box, sphere
from mindstage.scene.transforms import quaternion_from_matrix, rotation_matrix
from mindstage.sensors import CameraModel, CameraNoise
from mindstage.simulation import Simulation
from tests.cases import each_case

cv2 = pytest.importorskip("cv2")
trimesh = pytest.importorskip("trimesh")

PLAIN = CameraModel(fx=540.0, fy=520.0, cx=310.0, cy=245.0)
PLUMB_BOB = CameraModel(fx=540.0, fy=520.0, cx=310.0, cy=245.0, distortion=(-0.21, 0.06, 0.0012, -0.0008, 0.004))
WHITE, BLACK = PbrMaterial(color=(0.95, 0.95, 0.95)), PbrMaterial(color=(0.03, 0.03, 0.03))
SQUARE_M, COLUMNS, ROWS = 0.03, 9, 7


def looking(eye: tuple[float, float, float], at: tuple[float, float, float], roll: float = 0.0) -> Pose:
    """The pose of an optical frame."""
    forward = np.subtract(at, eye)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    right, down = np.cos(roll) * right + np.sin(roll) * down, np.cos(roll) * down - np.sin(roll) * right
    w, x, y, z = quaternion_from_matrix(np.stack([right, down, forward], axis=1)).tolist()
    return Pose(eye, (w, x, y, z))


def body(id: str, pose: Pose, size: tuple[float, float, float] = (0.1, 0.1, 0.1), cls: str = "urn:x#Thing") -> Body:
    return Body(id=BodyId(id), iri=Iri(f"urn:map#{id}"), cls=Iri(cls), pose=pose, size=size)


def simulation(shapes: dict[Body, tuple[VisualMesh, ...]]) -> Simulation:
    """Bodies with these meshes."""
    geometry = {
        each.id: BodyGeometry(key=str(each.id), visuals=visuals, collision_shapes=(), source=GeometrySource.MESH)
        for each, visuals in shapes.items()
    }
    found = Simulation(KnowledgeBase(), NullEngine())
    found.spawn(World(iri=Iri("urn:map"), bodies=tuple(shapes)), geometry=geometry)
    return found


def boxed(size: tuple[float, float, float], material: PbrMaterial = WHITE) -> tuple[VisualMesh, ...]:
    mesh = box(size)
    return (VisualMesh(mesh.points, mesh.faces, material, mesh.normals),)


def checkerboard() -> tuple[VisualMesh, ...]:
    """Squares in the plane of x and y, and a white margin; the first inner corner is the origin."""
    found = []
    for color, material in enumerate((WHITE, BLACK)):
        points = []
        for row in range(-2, ROWS + 1):
            for column in range(-2, COLUMNS + 1):
                is_margin = row in {-2, ROWS} or column in {-2, COLUMNS}
                if ((row + column) % 2 and not is_margin) == bool(color):
                    points += [(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)]
        corners = np.column_stack([np.array(points) * SQUARE_M, np.zeros(len(points))])
        first = np.arange(0, len(points), 4)[:, None]
        faces = (first + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3).astype(np.uint32)
        found.append(VisualMesh(corners, faces, material, np.tile([0.0, 0.0, 1.0], (len(points), 1))))
    return tuple(found)


@pytest.fixture(scope="module")
def kitchen() -> Iterator[Simulation]:
    with ms.open("bundled:kitchen", engine="null") as sim:
        yield sim


# -- geometry, by other libraries --------------------------------------------------------------------------------------


@each_case("model", [PLAIN, PLUMB_BOB], ids=lambda model: model.distortion_model or "none")
@each_case("view", [((0.14, 0.1, 0.5), 0.0), ((0.35, -0.1, 0.5), 0.3), ((-0.2, 0.3, 0.6), -0.5)])
def test_opencv_finds_a_checkerboard_where_camera_info_says(
    model: CameraModel, view: tuple[tuple[float, float, float], float]
) -> None:
    (eye, roll), middle = view, (0.12, 0.09, 0.0)
    with simulation({body("board", Pose((0.0, 0.0, 0.0))): checkerboard()}) as sim:
        camera = sim.add_camera("test", model, at=looking(eye, middle, roll))
        image = cv2.cvtColor(camera.rgb(), cv2.COLOR_RGB2GRAY)
        found, corners = cv2.findChessboardCornersSB(image, (COLUMNS, ROWS), flags=cv2.CALIB_CB_ACCURACY)
        assert found
        grid = np.array([(x, y, 0.0) for y in range(ROWS) for x in range(COLUMNS)]) * SQUARE_M
        position, rotation = np.array(camera.pose.position), rotation_matrix(np.array(camera.pose.quaternion))
        distortion = np.array(model.distortion or [0.0] * 5)
        seen, _ = cv2.projectPoints((grid - position) @ rotation, np.zeros(3), np.zeros(3), model.k, distortion)
        corners, seen = corners.reshape(ROWS, COLUMNS, 2), seen.reshape(-1, 2)
        orders = [corners[::down, ::right].reshape(-1, 2) for down in (1, -1) for right in (1, -1)]
        corners = min(
            orders, key=lambda each: float(np.abs(each - seen).max())
        )  # the pattern does not say which is first
        assert np.abs(corners - seen).max() < 0.5
        _, turned, moved = cv2.solvePnP(grid, corners.astype(float), model.k, distortion)
        board_rotation = cv2.Rodrigues(turned)[0]
        assert np.linalg.norm(-board_rotation.T @ moved.ravel() - position) < 2e-3
        cosine = (np.trace(board_rotation @ rotation) - 1) / 2
        assert np.degrees(np.arccos(np.clip(cosine, -1, 1))) < 0.1


@each_case("model", [PLAIN, PLUMB_BOB], ids=lambda model: model.distortion_model or "none")
def test_spheres_are_labeled_where_opencv_projects_them(model: CameraModel) -> None:
    random = np.random.default_rng(7)
    mesh = sphere((0.03, 0.03, 0.03))
    visuals = (VisualMesh(mesh.points, mesh.faces, WHITE, mesh.normals),)
    grid = [
        (x, y, float(random.uniform(-0.2, 0.3))) for x in np.linspace(-0.5, 0.5, 6) for y in np.linspace(-0.4, 0.4, 5)
    ]
    with simulation({body(f"s{at}", Pose(point)): visuals for at, point in enumerate(grid)}) as sim:
        camera = sim.add_camera("test", model, at=looking((0.3, -0.2, 1.6), (0.0, 0.0, 0.0), 0.2))
        segmentation = camera.segmentation()
        position, rotation = np.array(camera.pose.position), rotation_matrix(np.array(camera.pose.quaternion))
        points = (np.array(grid) - position) @ rotation
        seen, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), model.k, np.array(model.distortion or [0.0] * 5))
        for at, (column, row) in enumerate(seen.reshape(-1, 2)):
            rows, columns = np.nonzero(segmentation.mask(f"urn:map#s{at}"))
            assert len(rows) > 40
            assert (rows.mean(), columns.mean()) == pytest.approx((row, column), abs=0.5)
        assert np.abs(model.project(points) - seen.reshape(-1, 2)).max() < 1e-6


def rays_hit(sim: Simulation, position: Any, directions: Any) -> tuple[NDArray[np.float64], NDArray[np.object_]]:
    """The multiple of each direction at which trimesh meets a triangle (infinite for none), and the id of the body."""
    meshes, owners = [], []
    for each in sim.snapshot().bodies:
        rotation = rotation_matrix(np.array(each.pose.quaternion) / np.linalg.norm(each.pose.quaternion))
        for visual in sim.geometry[each.id].visuals:
            points = visual.points @ rotation.T + each.pose.position
            meshes.append(trimesh.Trimesh(points, visual.faces, process=False))
            owners += [str(each.id)] * len(visual.faces)
    scene = trimesh.util.concatenate(meshes)
    flat = directions.reshape(-1, 3)
    first = scene.ray.intersects_first(np.tile(position, (len(flat), 1)), flat)
    normals, corners = scene.face_normals[first], scene.triangles[first, 0]
    scale = ((corners - position) * normals).sum(axis=1) / (flat * normals).sum(axis=1)
    shape = directions.shape[:2]
    ids = np.array([*owners, ""], dtype=object)[first].reshape(shape)
    return np.where(first < 0, np.inf, scale).reshape(shape), ids


def neighbors(values: NDArray[Any]) -> NDArray[Any]:
    """The values in the 3 x 3 pixels around each one, 9 x h x w."""
    padded = np.pad(values, 1, mode="edge")
    height, width = values.shape
    return np.stack([padded[row : row + height, column : column + width] for row in range(3) for column in range(3)])


def bend(depth: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far depths are from those of a plane along rows and columns [m]."""
    padded = np.pad(depth, 1, mode="reflect", reflect_type="odd")
    along_rows = np.abs(padded[1:-1, 2:] - 2 * depth + padded[1:-1, :-2])
    return np.maximum(along_rows, np.abs(padded[2:, 1:-1] - 2 * depth + padded[:-2, 1:-1]))


def check_views(sim: Simulation, model: CameraModel, count: int, *, agreed: float, beside_edges: float = 0.0) -> None:
    """Compares depths and ids from random places in the kitchen with those of ray casting.

    Args:
        agreed: least share of depths that are equal.
        beside_edges: largest share of pixels that differ and are not within one pixel of an edge.
    """
    random = np.random.default_rng(38)
    equal, beside, pixels = 0, 0, 0
    for _ in range(count):
        eye = (float(random.uniform(-1.2, 1.2)), float(random.uniform(-0.2, 0.7)), float(random.uniform(1.0, 2.2)))
        at = (float(random.uniform(-2.2, 2.2)), float(random.choice([-1.7, 1.7])), float(random.uniform(0.1, 2.0)))
        camera = sim.add_camera("view", model, at=looking(eye, at, float(random.uniform(-3, 3))))
        image = camera.capture()
        rotation = rotation_matrix(np.array(camera.pose.quaternion))
        depth, ids = rays_hit(sim, np.array(eye), camera.model.rays() @ rotation.T)
        assert (np.isinf(image.depth) == np.isinf(depth)).mean() > 0.998
        seen, depth = np.where(np.isinf(image.depth), 1e3, image.depth), np.where(np.isinf(depth), 1e3, depth)
        is_near = np.abs(seen - depth) < 1e-3 + 1e-4 * depth
        equal, pixels = equal + int(is_near.sum()), pixels + depth.size
        codes = np.unique(ids.astype(str), return_inverse=True)[1].reshape(ids.shape)
        is_edge = np.ones(ids.shape, dtype=bool)  # at the border, an edge may be outside of the image
        is_edge[1:-1, 1:-1] = (neighbors(bend(depth) > 1e-3).any(axis=0) | (neighbors(codes) != codes).any(axis=0))[
            1:-1, 1:-1
        ]
        names = {0: "", **{label: str(each.id) for label, each in image.segmentation.legend.items()}}
        same = np.vectorize(names.__getitem__, otypes=[object])(image.segmentation.labels) == ids
        beside += int((~(is_near & same) & ~is_edge).sum())
    assert equal / pixels >= agreed
    assert beside / pixels <= beside_edges


SMALL = CameraModel.with_field_of_view(1.2, (160, 120))
SMALL_PLUMB_BOB = CameraModel(
    width=160, height=120, fx=117.0, fy=117.0, cx=79.5, cy=59.5, distortion=(-0.21, 0.06, 0.0012, -0.0008, 0.004)
)


def test_depths_and_ids_are_those_of_ray_casting(kitchen: Simulation) -> None:
    check_views(kitchen, SMALL, 6, agreed=0.998)


def test_distorted_depths_and_ids_are_those_of_ray_casting_but_at_edges(kitchen: Simulation) -> None:
    # They are sampled from an image without distortion, in which an edge may be half a pixel away.
    check_views(kitchen, SMALL_PLUMB_BOB, 3, agreed=0.9, beside_edges=1e-3)


@pytest.mark.slow
def test_depths_and_ids_are_those_of_ray_casting_in_200_views(kitchen: Simulation) -> None:
    check_views(kitchen, SMALL, 200, agreed=0.998)


def test_labels_and_iris_correspond_one_to_one(kitchen: Simulation) -> None:
    legend = kitchen.add_camera("view", SMALL, at=looking((0.5, 0.3, 1.6), (-0.5, 1.7, 0.9))).segmentation().legend
    assert {each.id: each.iri for each in legend.values()} == {each.id: each.iri for each in kitchen.snapshot().bodies}
    assert len({each.iri for each in legend.values()}) == len(legend)
    assert 0 not in legend


# -- what is seen ------------------------------------------------------------------------------------------------------

AT = looking((0.0, -2.0, 0.5), (0.0, 0.0, 0.5))


def two_boxes() -> Simulation:
    near = body("near", Pose((-0.3, 0.0, 0.5)), cls="urn:x#Cup")
    return simulation(
        {
            near: boxed((0.4, 0.4, 0.4)),
            body("far", Pose((0.3, 1.0, 0.5)), cls="urn:x#Cup"): boxed((0.4, 0.4, 0.4)),
            body("wall", Pose((0.0, 2.0, 0.5)), (6.0, 0.1, 4.0), cls="urn:x#Plate"): boxed((6.0, 0.1, 4.0)),
        }
    )


def test_a_camera_sees_depths_normals_classes_and_moved_bodies() -> None:
    with two_boxes() as sim:
        image = sim.add_camera("test", at=AT).capture()
        column = int(PLAIN.width / 2 - 525 * 0.3 / 1.8)
        assert image.segmentation.at(240, column).id == "near"  # type: ignore[union-attr]
        assert image.depth[240, column] == pytest.approx(1.8, abs=1e-4)
        assert image.normals[240, column] == pytest.approx([0.0, 0.0, -1.0], abs=1e-5)
        labels, names = image.segmentation.classes()
        assert names == ("urn:x#Cup", "urn:x#Plate")
        assert labels[240, column] == 1
        assert labels[20, 20] == 2
        assert (labels == 1).sum() == sum(image.segmentation.seen()[BodyId(id)] for id in ("near", "far"))
        sim.edits.move(BodyId("near"), Pose((-0.3, 0.5, 0.5)))
        assert sim.camera("test").depth()[240, column] == pytest.approx(2.3, abs=1e-4)


def test_a_camera_on_a_body_moves_with_it_and_is_gone_with_it() -> None:
    with two_boxes() as sim:
        camera = sim.add_camera("test", at=Pose((0.0, -2.0, 0.0), AT.quaternion), on="urn:map#near")
        assert camera.pose.position == pytest.approx((-0.3, -2.0, 0.5))
        before = camera.depth()[240, 320]
        sim.edits.move(BodyId("near"), Pose((-0.3, 0.25, 0.5)))
        assert camera.depth()[240, 320] == pytest.approx(before, abs=1e-4)
        sim.edits.delete([BodyId("near")])
        with pytest.raises(BodyNotFoundError, match="near"):
            camera.rgb()


def test_bodies_that_are_added_and_deleted_are_seen_so() -> None:
    with two_boxes() as sim:
        camera = sim.add_camera("test", at=AT)
        assert BodyId("far") in camera.segmentation().seen()
        sim.edits.delete([BodyId("far")])
        assert camera.segmentation().seen().keys() == {"near", "wall"}


def test_shadows_fall_where_the_sun_says() -> None:
    flat = body("floor", Pose((0.0, 0.0, -0.05)), (8.0, 8.0, 0.1))
    high = body("box", Pose((0.0, 0.0, 1.0)), (0.4, 0.4, 0.1))
    with simulation({flat: boxed((8.0, 8.0, 0.1)), high: boxed((0.4, 0.4, 0.1))}) as sim:
        camera = sim.add_camera("test", at=looking((0.0, -3.0, 3.0), (0.0, 0.0, 0.0)))
        toward = np.array([np.cos(0.9) * np.cos(0.9), np.cos(0.9) * np.sin(0.9), np.sin(0.9)])
        shadow = np.array([0.0, 0.0, 1.0]) - toward / toward[2]
        beside = shadow * [-1.0, 1.0, 1.0]
        rotation = rotation_matrix(np.array(camera.pose.quaternion))
        places = (np.stack([shadow, beside]) - camera.pose.position) @ rotation
        (column, row), (other_column, other_row) = np.rint(camera.model.project(places)).astype(int)
        image = camera.rgb().astype(int)
        assert image[row, column].sum() < 0.9 * image[other_row, other_column].sum()


# -- determinism and noise ---------------------------------------------------------------------------------------------


def test_equal_seeds_and_times_give_equal_bytes(kitchen: Simulation) -> None:
    noise = CameraNoise(color_std=0.01, depth_std_m=0.002, dropout=0.05, seed=4)
    model = CameraModel.with_field_of_view(1.2, (160, 120), noise=noise)
    pose = looking((0.5, 0.3, 1.6), (-0.5, 1.7, 0.9))
    first = kitchen.add_camera("noisy", model, at=pose).capture()
    with ms.open("bundled:kitchen", engine="null") as other:
        second = other.add_camera("noisy", model, at=pose).capture()
    for name in ("rgb", "depth", "normals"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()
    clean = kitchen.add_camera("clean", SMALL, at=pose).capture()
    assert np.isnan(first.depth).mean() == pytest.approx(0.05, abs=0.01)
    error = (first.depth - clean.depth)[~np.isnan(first.depth)]
    assert error.std() == pytest.approx(0.002, rel=0.05)
    assert np.abs(first.rgb.astype(int) - clean.rgb).max() > 2
    assert not np.isnan(clean.depth).any()


# -- what is refused ---------------------------------------------------------------------------------------------------


def test_a_camera_inside_of_a_body_is_refused_and_others_go_on() -> None:
    with two_boxes() as sim:
        sim.add_camera("inside", at=looking((0.0, 2.0, 0.5), (0.0, 0.0, 0.5)))
        good = sim.add_camera("good", at=AT)
        with pytest.raises(InvalidArgumentError, match=r"camera inside: it is inside of wall.*place it in free space"):
            sim.camera("inside").rgb()
        assert good.rgb().shape == (480, 640, 3)


@each_case(
    ("fields", "message"),
    [
        ({"width": 0}, "width 0"),
        ({"height": 100_000}, "height 100000"),
        ({"fx": 0.0}, "fx 0"),
        ({"near_m": 2.0, "far_m": 1.0}, "not below far_m"),
        ({"distortion": (0.1, 0.2)}, "2 coefficients; give k1, k2, p1, p2, k3"),
    ],
)
def test_impossible_cameras_are_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        CameraModel(**fields)


def test_a_distortion_without_an_inverse_is_refused() -> None:
    with two_boxes() as sim, pytest.raises(InvalidArgumentError, match="two directions to one pixel"):
        sim.add_camera("test", CameraModel(distortion=(-2.0, 0.0, 0.0, 0.0, 0.0)), at=AT).rgb()


def test_an_unknown_camera_is_refused_with_those_that_exist() -> None:
    with two_boxes() as sim:
        sim.add_camera("ceiling", at=AT)
        with pytest.raises(NameNotFoundError, match="ceiling"):
            sim.camera("cieling")
        assert sim.camera().name == "ceiling"


def test_without_opengl_the_error_names_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> None:
        raise OSError("libEGL.so.1 is not installed")

    monkeypatch.setattr(gl_context, "_create_egl", missing)
    monkeypatch.setattr(gl_context, "_create_osmesa", missing)
    with two_boxes() as sim:
        with pytest.raises(RendererUnavailableError, match="install libegl1"):
            sim.add_camera("test", at=AT).rgb()
        sim.step(0.1)
        assert sim.state.time_s == pytest.approx(0.1)
