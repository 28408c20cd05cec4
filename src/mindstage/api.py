"""The functions of `import mindstage as ms`: open, load, save, compare and view maps, worlds and simulations.

    with ms.open("kitchen.owl") as sim:
        sim.step(1.0)
        sim.save("now.owl")
    print(ms.diff("kitchen.owl", "now.owl"))

The `mindstage` command calls the same functions. Other packages are imported when a function first needs them.
"""

from __future__ import annotations

import os
import time
from collections.abc import Collection, Iterable, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

from mindstage.access.limits import Timeout
from mindstage.errors import InvalidArgumentError
from mindstage.ranges import Port, WallTime, checked

if TYPE_CHECKING:
    from mindstage.access.certificates import TlsCertificate
    from mindstage.access.limits import VisitorLimits
    from mindstage.assets.mesh_import import MeshProgress
    from mindstage.engines import Engine
    from mindstage.knowledge import KnowledgeBase, SparqlEndpoint
    from mindstage.maps import UnitConventions
    from mindstage.maps.urdf.xacro_process import XacroRequest
    from mindstage.saving import FileDialect
    from mindstage.scene import World, WorldDiff
    from mindstage.simulation import Simulation
    from mindstage.viewer import Viewer

__all__ = ["connect", "diff", "load", "load_knowledge", "make_simulation", "open", "save", "view"]

StrPath = str | os.PathLike[str]

_POLL_S = 0.2
"""Interval at which a blocking `view` checks its deadline [s]."""


@checked
def open(
    maps: StrPath | Iterable[StrPath] = (),
    *,
    map_name: str | None = None,
    engine: Engine | str = "mujoco",
    ontologies: StrPath | Iterable[StrPath] = (),
    bundled_ontology: bool = True,
    urdf: StrPath | Iterable[StrPath] = (),
    xacro: XacroRequest = None,
    conventions: UnitConventions | Sequence[UnitConventions] | None = None,
    store: StrPath | None = None,
    endpoint: SparqlEndpoint | str | None = None,
    assets: StrPath | Iterable[StrPath] = (),
    primitive_shapes: bool = False,
    timeout_s: Timeout = 10.0,
) -> Simulation:
    """Opens semantic maps as a simulation: loads a knowledge base, makes an engine and spawns the maps in it.

    The simulation is paused until `step` or `play`. `Simulation.reports` lists what could not be spawned and what was
    assumed. Closing the simulation (or leaving its `with` block) closes the engine and the knowledge base.

    Args:
        maps: files of semantic maps (OWL in RDF/XML or Turtle) or robot descriptions (URDF, xacro); "bundled:kitchen"
            is the kitchen included in Mindstage. Without maps, the simulation is empty.
        map_name: the IRI or local name of the map to spawn; by default all maps in the files.
        engine: "mujoco", "godot", "godot:window", "null" (no physics), the address of a remote engine
            (`ros://HOST:PORT/NAMESPACE`), or an engine, which the simulation then owns.
        ontologies: further ontology files, or folders of ROS packages in which `package://` URLs are resolved.
        bundled_ontology: whether the bundled household ontology is loaded.
        urdf: robot descriptions (URDF, xacro) that define the links which the maps refer to.
        xacro: whether the robot descriptions among `maps` and `robots` are expanded if they contain xacro; by default
            those whose name ends in `.xacro`, so False never runs a macro. A mapping gives the values of their
            arguments (`xacro:arg`), and asks for the expansion too.
        conventions: units, frame and quaternion order of the maps, which are otherwise inferred: one for all maps, or
            one per map.
        store: the folder of a persistent knowledge base.
        endpoint: a SPARQL endpoint whose statements are queried together with those of the maps.
        assets: folders of mesh files, in addition to the files that the maps refer to.
        primitive_shapes: whether each body has only the primitive shape of the map (box, sphere, cylinder).
        timeout_s: timeout of a call into the simulation [s]; for spawning it grows with the number of bodies.

    Raises:
        EngineUnavailableError: the engine is unknown, or cannot be loaded, started or reached.
        SourceParseError: a file cannot be read, or a folder does not exist.
        MapNotFoundError: the files contain no map, or none of that name.
        InvalidArgumentError: the arguments are mutually exclusive.
    """
    from mindstage.engines import make_engine

    with ExitStack() as on_error:
        running = make_engine(engine) if isinstance(engine, str) else engine  # first: a wrong name fails early
        on_error.callback(running.close)
        listed = _as_list(maps)
        knowledge = load_knowledge(
            listed,
            ontologies=ontologies,
            bundled_ontology=bundled_ontology,
            urdf=urdf,
            xacro=xacro,
            conventions=conventions,
            store=store,
            endpoint=endpoint,
        )
        on_error.callback(knowledge.close)
        sim = make_simulation(knowledge, running, assets=assets, primitive_shapes=primitive_shapes, timeout_s=timeout_s)
        on_error.callback(sim.close)
        sim.on_close(knowledge.close)
        if map_name is not None or (listed and not knowledge.maps()):
            sim.spawn(map_name)
        elif listed:
            for iri in knowledge.maps():
                sim.spawn(iri)
        on_error.pop_all()
    return sim


@checked
def connect(
    url: str,
    maps: StrPath | Iterable[StrPath] = (),
    *,
    ontologies: StrPath | Iterable[StrPath] = (),
    bundled_ontology: bool = True,
    urdf: StrPath | Iterable[StrPath] = (),
    xacro: XacroRequest = None,
    conventions: UnitConventions | Sequence[UnitConventions] | None = None,
    control_time: bool = False,
    timeout_s: Timeout = 10.0,
) -> Simulation:
    """Connects to a remote simulation (`mindstage serve`, or Unreal with its plugin).

    Nothing is spawned: the bodies are those of the remote world, and closing the connection does not remove them. To
    spawn a map in a remote engine use `open(map, engine=url)`.

    Args:
        url: `ros://HOST:PORT/NAMESPACE`.
        maps: the maps of that world, for questions about their individuals; they are loaded, not spawned.
        ontologies: see `open`.
        bundled_ontology: see `open`.
        urdf: see `open`.
        xacro: see `open`.
        conventions: see `open`.
        control_time: whether the remote time advances only by `step` until the connection is closed. By default the
            remote simulation keeps running.
        timeout_s: timeout of a call [s].

    Raises:
        EngineUnavailableError: there is no response from the URL, or it does not serve an engine.
        SourceParseError: a file cannot be read.
    """
    from mindstage.engines.remote import connect as connect_engine

    with ExitStack() as on_error:
        engine = connect_engine(url, timeout_s=timeout_s, control_time=control_time)
        on_error.callback(engine.close)
        knowledge = load_knowledge(
            maps,
            ontologies=ontologies,
            bundled_ontology=bundled_ontology,
            urdf=urdf,
            xacro=xacro,
            conventions=conventions,
        )
        on_error.callback(knowledge.close)
        sim = make_simulation(knowledge, engine, timeout_s=timeout_s)
        sim.on_close(knowledge.close)
        on_error.pop_all()
    return sim


def load(
    maps: StrPath | Iterable[StrPath],
    *,
    map_name: str | None = None,
    ontologies: StrPath | Iterable[StrPath] = (),
    bundled_ontology: bool = True,
    urdf: StrPath | Iterable[StrPath] = (),
    xacro: XacroRequest = None,
    conventions: UnitConventions | Sequence[UnitConventions] | None = None,
) -> World:
    """Loads one map as a world: bodies, joints, lights, and all other statements of the map as facts.

    Args:
        maps: see `open`.
        map_name: the IRI or local name of the map; by default the only one.
        ontologies: see `open`.
        bundled_ontology: see `open`.
        urdf: see `open`.
        xacro: see `open`.
        conventions: see `open`.

    Raises:
        SourceParseError: a file cannot be read.
        MapNotFoundError: the files contain no map, or none of that name.
        AmbiguousMapError: the files contain several maps, and `map_name` is not given.
    """
    with load_knowledge(
        maps,
        ontologies=ontologies,
        bundled_ontology=bundled_ontology,
        urdf=urdf,
        xacro=xacro,
        conventions=conventions,
    ) as knowledge:
        return knowledge.world(map_name)


def save(
    what: World | Simulation,
    path: StrPath,
    *,
    knowledge: KnowledgeBase | None = None,
    format: str | None = None,
    dialect: FileDialect | str | None = None,
    assets: StrPath | Iterable[StrPath] = (),
    primitive_shapes: bool = False,
    godot: StrPath | None = None,
) -> tuple[str, ...]:
    """Writes a world, or the current state of a simulation, to a file.

    Args:
        what: the world or the simulation.
        path: the file. The suffix determines the format: .owl or .rdf (RDF/XML), .ttl (Turtle), .mjcf or .xml
            (MuJoCo), .glb (glTF), .tscn (Godot).
        knowledge: the knowledge base that the world was read from; by default the simulation's.
        format: owl, ttl, mjcf, glb, tscn, or one of an installed package; by default the format of the suffix.
        dialect: the vocabulary of a semantic map: semlog (the default), soma, same (that of the map that was read),
            given (that of the map from which this one was converted).
        assets: folders of mesh files, for MJCF, glTF and Godot scenes.
        primitive_shapes: whether MJCF, glTF and Godot scenes get only the primitive shape of each body.
        godot: path of the Godot executable, for Godot scenes.

    Returns:
        Notes, one sentence each, on what the format cannot express.

    Raises:
        MapWriteError: the suffix is unknown, the format cannot express the world, or the file cannot be written.
        InvalidArgumentError: the format or the dialect is unknown.
        EngineUnavailableError: Godot is not installed.
    """
    from mindstage.saving import save_world
    from mindstage.scene import World

    world = what if isinstance(what, World) else what.snapshot()
    known = knowledge if isinstance(what, World) else knowledge or what.knowledge
    return save_world(
        world,
        path,
        knowledge=known,
        format=format,
        dialect=dialect,
        assets=assets,
        primitive_shapes=primitive_shapes,
        godot=godot,
    )


def diff(
    a: StrPath | World | Simulation,
    b: StrPath | World | Simulation,
    *,
    ontologies: StrPath | Iterable[StrPath] = (),
    bundled_ontology: bool = True,
    urdf: StrPath | Iterable[StrPath] = (),
    xacro: XacroRequest = None,
    conventions: UnitConventions | Sequence[UnitConventions] | None = None,
) -> WorldDiff:
    """Compares two worlds: bodies, joints, attachments, lights and facts. `print` the result for a summary.

    Args:
        a: the path of a map, a world, or a simulation, whose current state is compared.
        b: the same.
        ontologies: for maps given by path; see `open`.
        bundled_ontology: see `open`.
        urdf: see `open`.
        xacro: see `open`.
        conventions: for maps given by path: one for both, or one for `a` and one for `b`.

    Raises:
        SourceParseError: a file cannot be read.
        InvalidArgumentError: the number of conventions is neither one nor two.
        MapNotFoundError: a file contains no map.
        AmbiguousMapError: a file contains several maps; `load` one of them by name instead.
    """
    from mindstage.scene import World
    from mindstage.scene import diff as compare
    from mindstage.simulation import Simulation

    def world_of(each: StrPath | World | Simulation, conventions: UnitConventions | None) -> World:
        if isinstance(each, World):
            return each
        if isinstance(each, Simulation):
            return each.snapshot()
        return load(
            each,
            ontologies=ontologies,
            bundled_ontology=bundled_ontology,
            urdf=urdf,
            xacro=xacro,
            conventions=conventions,
        )

    of_a, of_b = _conventions_of(conventions, 2)
    return compare(world_of(a, of_a), world_of(b, of_b))


@checked
def view(
    sim: Simulation,
    *,
    port: Port | None = None,
    host: str = "127.0.0.1",
    token: str | None = None,
    origins: Collection[str] = (),
    tls: TlsCertificate | None = None,
    visitor_limits: VisitorLimits | None = None,
    autosave: bool = False,
    block: bool = False,
    duration_s: WallTime | None = None,
) -> Viewer:
    """Serves a web page that displays and edits a simulation, at `Viewer.url`.

    The page is updated until the viewer or the simulation is closed; closing the simulation closes its viewers. The
    commands `mindstage ask`, `sparql` and `prolog` of the same user find the simulation with `--running`.

    Args:
        port: the TCP port; 0 lets the operating system choose. By default 8080, or the next free one.
        host: the address to listen on. The default is the loopback interface; any other needs a token.
        token: the token that clients must present.
        origins: further origins from which the page may be opened, such as `https://robot.example`.
        tls: the certificate for https://; None serves http://.
        visitor_limits: limits of each client address; None for the defaults.
        autosave: whether edits are saved automatically, as the commands do; see `Viewer`.
        block: whether to play in real time until Ctrl-C, until the simulation is closed or until `duration_s`, and to
            close the page then. By default the function returns at once.
        duration_s: how long to block, in wall time [s].

    Raises:
        AuthenticationError: the host is not a loopback address, and there is no token.
        CertificateError: the certificate cannot be used.
        ViewerUnavailableError: the server cannot listen at that address.
    """
    from mindstage.access.limits import VisitorLimits
    from mindstage.prolog import is_installed, solve_query
    from mindstage.ros.queries import QueryServer
    from mindstage.viewer import Viewer

    prolog = solve_query if is_installed() else None
    limits = visitor_limits or VisitorLimits()
    page = Viewer(
        sim,
        host=host,
        port=port,
        token=token,
        origins=origins,
        tls=tls,
        visitor_limits=limits,
        prolog=prolog,
        autosave=autosave,
    )
    sim.on_close(page.close)
    QueryServer.start(sim, page=page.url)
    if block:
        with page:
            _play(sim, duration_s)
    return page


def load_knowledge(
    maps: StrPath | Iterable[StrPath] = (),
    *,
    ontologies: StrPath | Iterable[StrPath] = (),
    bundled_ontology: bool = True,
    urdf: StrPath | Iterable[StrPath] = (),
    xacro: XacroRequest = None,
    conventions: UnitConventions | Sequence[UnitConventions] | None = None,
    store: StrPath | None = None,
    endpoint: SparqlEndpoint | str | None = None,
    closure: bool = False,
) -> KnowledgeBase:
    """Creates a knowledge base and loads maps into it; used by `open` and `load`.

    Args:
        maps: see `open`.
        ontologies: see `open`.
        bundled_ontology: see `open`.
        urdf: see `open`.
        xacro: see `open`.
        conventions: see `open`.
        store: see `open`.
        endpoint: see `open`.
        closure: whether the OWL 2 RL closure is derived after loading.

    Raises:
        SourceParseError: one of the files cannot be read.
        StoreError: the store folder cannot be used.
        InvalidArgumentError: the endpoint is not a URL, `store` is combined with `endpoint` or `closure`, or the number
            of conventions differs from the number of maps.
        ReasonerUnavailableError: the extra "closure" is not installed.
    """
    from mindstage.knowledge import KnowledgeBase
    from mindstage.maps import UnitConventions

    if closure and store is not None:
        cause = "it would write derived statements into a store that is shared"
        raise InvalidArgumentError("the closure", cause=cause, remedy="load the files without a store")
    listed = _as_list(maps)
    each = _conventions_of(conventions, len(listed))
    knowledge = KnowledgeBase(bundled_ontology=bundled_ontology, store=store, endpoint=endpoint)
    try:
        if len(set(each)) <= 1:  # in one call, so that imports shared by the maps are read once
            knowledge.load(
                listed,
                ontologies=ontologies,
                urdf=urdf,
                xacro=xacro,
                conventions=each[0] if each else UnitConventions(),
            )
        else:
            for path, own in zip(listed, each, strict=True):
                knowledge.load(path, ontologies=ontologies, urdf=urdf, xacro=xacro, conventions=own)
        if closure:
            knowledge.materialize()
    except BaseException:
        knowledge.close()
        raise
    return knowledge


def _conventions_of(
    conventions: UnitConventions | Sequence[UnitConventions] | None, count: int
) -> list[UnitConventions]:
    """The conventions of each of some maps.

    Raises:
        InvalidArgumentError: there are several, but not one for each map.
    """
    from mindstage.maps import UnitConventions

    if conventions is None or isinstance(conventions, UnitConventions):
        return [conventions or UnitConventions()] * count
    each = list(conventions)
    if len(each) != count:
        cause = f"there are {len(each)} for {count} maps"
        raise InvalidArgumentError("the conventions", cause=cause, remedy="give one for each map, or one for all")
    return each


@checked
def make_simulation(
    knowledge: KnowledgeBase,
    engine: Engine,
    *,
    assets: StrPath | Iterable[StrPath] = (),
    primitive_shapes: bool = False,
    timeout_s: Timeout = 10.0,
    mesh_progress: MeshProgress | None = None,
    decompose: bool = True,
) -> Simulation:
    """Creates an empty simulation that owns the engine, with geometry from meshes and from shape rules of classes.

    Args:
        knowledge: the knowledge base; it is not closed with the simulation.
        engine: the engine; it is closed with the simulation.
        assets: see `open`.
        primitive_shapes: see `open`.
        timeout_s: see `open`.
        mesh_progress: called with the number of mesh files that are imported, and of all that have to be.
        decompose: whether collision shapes are convex parts of meshes; otherwise they are convex hulls, which suffice
            where nothing moves, as in a picture, and take little of the time.

    Raises:
        SourceParseError: one of the asset folders does not exist.
    """
    from mindstage.saving import mesh_assets
    from mindstage.simulation import Simulation

    if primitive_shapes:
        return Simulation(knowledge, engine, timeout_s=timeout_s, primitive_shapes=True)
    meshes = mesh_assets(assets, knowledge, progress=mesh_progress, decompose=decompose)
    knowledge.use_meshes(meshes.bounds)
    return Simulation(knowledge, engine, timeout_s=timeout_s, meshes=meshes)


def _play(sim: Simulation, duration_s: float | None) -> None:
    end = None if duration_s is None else time.monotonic() + duration_s
    sim.play()
    try:
        while not sim.closed and (end is None or time.monotonic() < end):
            time.sleep(_POLL_S if end is None else max(0.0, min(_POLL_S, end - time.monotonic())))
    except KeyboardInterrupt:
        pass
    finally:
        if not sim.closed:
            sim.pause()


def _as_list(paths: StrPath | Iterable[StrPath]) -> list[StrPath]:
    return [paths] if isinstance(paths, str | os.PathLike) else list(paths)
