"""The functions of `import mindstage as ms`: maps become worlds and simulations, which are shown, saved and compared.

    with ms.open("kitchen.owl") as sim:
        sim.step(1.0)
        sim.save("now.owl")
    print(ms.diff("kitchen.owl", "now.owl"))

The `mindstage` command calls the same functions. Nothing heavy is imported before one of them needs it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Collection, Iterable, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

from mindstage.errors import InvalidArgumentError

if TYPE_CHECKING:
    from mindstage.engines import Engine
    from mindstage.knowledge import KnowledgeBase, SparqlEndpoint, UnitConventions
    from mindstage.saving import FileDialect, FileFormat
    from mindstage.scene import World, WorldDiff
    from mindstage.simulation import Simulation
    from mindstage.viewer import Viewer

__all__ = ["connect", "diff", "load", "load_knowledge", "make_simulation", "open", "save", "view"]

StrPath = str | os.PathLike[str]

_POLL_S = 0.2
"""How often a blocking `view` checks whether its time is up [s]."""


def open(
    maps: StrPath | Iterable[StrPath] = (),
    *,
    map_name: str | None = None,
    engine: Engine | str = "mujoco",
    ontologies: StrPath | Iterable[StrPath] = (),
    bundled_ontology: bool = True,
    robots: StrPath | Iterable[StrPath] = (),
    conventions: UnitConventions | Sequence[UnitConventions] | None = None,
    store: StrPath | None = None,
    endpoint: SparqlEndpoint | str | None = None,
    assets: StrPath | Iterable[StrPath] = (),
    plain_shapes: bool = False,
    timeout_s: float = 10.0,
) -> Simulation:
    """Opens semantic maps as a simulation: a knowledge base, their worlds, and an engine that they are spawned in.

    Time stands still until `step` or `play`. What could not be spawned, and what was assumed, is in `reports`. Closing
    the simulation (or leaving its `with` block) closes the engine and the knowledge base.

    Args:
        maps: files of semantic maps (OWL in RDF/XML or Turtle) or robot descriptions (URDF, xacro); "bundled:kitchen"
            is the kitchen that comes with Mindstage. Without any, the simulation is empty.
        map_name: the IRI or local name of the map to spawn; by default every map that the files hold.
        engine: "mujoco", "godot", "godot:window", "null" (no physics), the address of a remote engine
            (`ros://HOST:PORT/NAMESPACE`), or an engine, which the simulation then owns.
        ontologies: more files of classes, or folders of ROS packages in which `package://` names are looked up.
        bundled_ontology: whether the bundled household ontology is loaded.
        robots: robot descriptions with the geometry and joints of maps that only name links.
        conventions: units, frame and quaternion order of the maps, where they do not say: one for all, or one per map.
        store: a folder in which the knowledge base is kept.
        endpoint: a SPARQL endpoint, whose statements are joined with those of the maps.
        assets: folders of mesh files, besides what the maps refer to.
        plain_shapes: whether every body is only the primitive of the map (box, sphere, cylinder) in its size.
        timeout_s: how long a call into the simulation may take [s]; spawning has more, by the number of bodies.

    Raises:
        EngineUnavailableError: there is no such engine, or it cannot be loaded, started or reached.
        SourceParseError: a file cannot be read, or a folder does not exist.
        MapNotFoundError: the files hold no map, or none of that name.
        InvalidArgumentError: arguments exclude one another.
    """
    from mindstage.engines import make_engine

    with ExitStack() as on_error:
        running = make_engine(engine) if isinstance(engine, str) else engine  # first: a wrong name fails at once
        on_error.callback(running.close)
        listed = _listed(maps)
        knowledge = load_knowledge(
            listed,
            ontologies=ontologies,
            bundled_ontology=bundled_ontology,
            robots=robots,
            conventions=conventions,
            store=store,
            endpoint=endpoint,
        )
        on_error.callback(knowledge.close)
        sim = make_simulation(knowledge, running, assets=assets, plain_shapes=plain_shapes, timeout_s=timeout_s)
        on_error.callback(sim.close)
        sim.on_close(knowledge.close)
        if map_name is not None or (listed and not knowledge.maps()):
            sim.spawn(map_name)
        elif listed:
            for iri in knowledge.maps():
                sim.spawn(iri)
        on_error.pop_all()
    return sim


def connect(
    url: str,
    maps: StrPath | Iterable[StrPath] = (),
    *,
    ontologies: StrPath | Iterable[StrPath] = (),
    robots: StrPath | Iterable[StrPath] = (),
    holds_time: bool = False,
    timeout_s: float = 10.0,
) -> Simulation:
    """Connects to a world that runs elsewhere (`mindstage serve`, or Unreal with its plugin), as a simulation here.

    Nothing is spawned: bodies are those that are there already, and closing the connection leaves them there. To spawn
    a map in a remote engine use `open(map, engine=url)`.

    Args:
        url: `ros://HOST:PORT/NAMESPACE`.
        maps: the maps of that world, for questions about their individuals; only read.
        ontologies: see `open`.
        robots: see `open`.
        holds_time: whether time there passes by `step` only, until the connection is closed. By default the world goes
            on by itself.
        timeout_s: how long a call may take [s].

    Raises:
        EngineUnavailableError: nothing answers there, or no engine.
        SourceParseError: a file cannot be read.
    """
    from mindstage.engines import connect as connect_engine

    with ExitStack() as on_error:
        engine = connect_engine(url, timeout_s=timeout_s, control_time=holds_time)
        on_error.callback(engine.close)
        knowledge = load_knowledge(maps, ontologies=ontologies, robots=robots)
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
    robots: StrPath | Iterable[StrPath] = (),
    conventions: UnitConventions | Sequence[UnitConventions] | None = None,
) -> World:
    """Reads one map as plain data: bodies, joints, lights and every other statement.

    Args:
        maps: see `open`.
        map_name: the IRI or local name of the map; by default the only one.
        ontologies: see `open`.
        bundled_ontology: see `open`.
        robots: see `open`.
        conventions: see `open`.

    Raises:
        SourceParseError: a file cannot be read.
        MapNotFoundError: the files hold no map, or none of that name.
        AmbiguousMapError: they hold several, and no name is given.
    """
    with load_knowledge(
        maps, ontologies=ontologies, bundled_ontology=bundled_ontology, robots=robots, conventions=conventions
    ) as knowledge:
        return knowledge.world(map_name)


def save(
    what: World | Simulation,
    path: StrPath,
    *,
    knowledge: KnowledgeBase | None = None,
    format: FileFormat | str | None = None,
    dialect: FileDialect | str | None = None,
    assets: StrPath | Iterable[StrPath] = (),
    plain_shapes: bool = False,
    godot: StrPath | None = None,
) -> tuple[str, ...]:
    """Writes a world, or a simulation as it is now, to a file.

    Args:
        what: the world or the simulation.
        path: the file. The suffix determines the format: .owl or .rdf (RDF/XML), .ttl (Turtle), .mjcf or .xml
            (MuJoCo), .glb (glTF), .tscn (Godot).
        knowledge: the knowledge base that the world was read from; by default the simulation's.
        format: instead of the one of the suffix: owl, ttl, mjcf, glb, tscn.
        dialect: of a semantic map: semlog (the default), soma, same (that of the map that was read), given (that of the
            map from which this one was converted).
        assets: folders of mesh files, for MJCF, glTF and Godot scenes.
        plain_shapes: whether these formats get each body's primitive shape only.
        godot: the Godot program that makes a Godot scene.

    Returns:
        Notes, one sentence each, on what the file cannot hold.

    Raises:
        MapWriteError: no format has this suffix, the world holds something that the format cannot, or the file cannot
            be written.
        InvalidArgumentError: there is no such format or dialect.
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
        plain_shapes=plain_shapes,
        godot=godot,
    )


def diff(
    a: StrPath | World | Simulation,
    b: StrPath | World | Simulation,
    *,
    ontologies: StrPath | Iterable[StrPath] = (),
    bundled_ontology: bool = True,
) -> WorldDiff:
    """Compares two worlds in everything that they hold; `print` it for a summary.

    Args:
        a: a map's path, a world, or a simulation, which is compared as it is now.
        b: the same.
        ontologies: for the maps that are read here; see `open`.
        bundled_ontology: see `open`.

    Raises:
        SourceParseError: a file cannot be read.
        MapNotFoundError: a file holds no map.
        AmbiguousMapError: a file holds several maps; load the one that is meant.
    """
    from mindstage.scene import World
    from mindstage.scene import diff as compare
    from mindstage.simulation import Simulation

    def world_of(each: StrPath | World | Simulation) -> World:
        if isinstance(each, World):
            return each
        if isinstance(each, Simulation):
            return each.snapshot()
        return load(each, ontologies=ontologies, bundled_ontology=bundled_ontology)

    return compare(world_of(a), world_of(b))


def view(
    sim: Simulation,
    *,
    port: int = 8080,
    host: str = "127.0.0.1",
    token: str | None = None,
    origins: Collection[str] = (),
    block: bool = False,
    duration_s: float | None = None,
) -> Viewer:
    """Serves the page on which a simulation is seen and edited in a browser, at the `url` of what is returned.

    The page follows the simulation until either is closed; closing the simulation closes its pages.

    Args:
        sim: the simulation.
        port: where that one is taken, the next free one is used; 0 lets the system choose.
        host: the address to listen on. The default is this machine only; any other needs a token.
        token: what visitors must know.
        origins: further addresses under which the page may be opened, such as `https://robot.example`.
        block: whether to play in real time until Ctrl-C, until the simulation is closed or until the duration is over,
            and to close the page then. By default the function returns at once, as notebooks need it.
        duration_s: how long to block, in real time [s].

    Raises:
        AuthenticationError: others could reach the page, and there is no token.
        ViewerUnavailableError: nothing can be served there.
    """
    from mindstage.prolog import is_installed, solve_query
    from mindstage.viewer import Viewer

    prolog = solve_query if is_installed() else None
    page = Viewer(sim, host=host, port=port, token=token, origins=origins, prolog=prolog)
    sim.on_close(page.close)
    if block:
        with page:
            _play(sim, duration_s)
    return page


def load_knowledge(
    maps: StrPath | Iterable[StrPath] = (),
    *,
    ontologies: StrPath | Iterable[StrPath] = (),
    bundled_ontology: bool = True,
    robots: StrPath | Iterable[StrPath] = (),
    conventions: UnitConventions | Sequence[UnitConventions] | None = None,
    store: StrPath | None = None,
    endpoint: SparqlEndpoint | str | None = None,
    closure: bool = False,
) -> KnowledgeBase:
    """Makes a knowledge base that has loaded maps; `open` and `load` use it.

    Args:
        maps: see `open`.
        ontologies: see `open`.
        bundled_ontology: see `open`.
        robots: see `open`.
        conventions: see `open`.
        store: see `open`.
        endpoint: see `open`.
        closure: whether everything that follows by OWL 2 RL is derived at once.

    Raises:
        SourceParseError: one of the files cannot be read.
        StoreError: the folder cannot be used.
        InvalidArgumentError: the endpoint's address is none, store and endpoint are both given, there are not as many
            conventions as maps, or a closure would be derived into a store that others use.
        ReasonerUnavailableError: the extra "closure" is not installed.
    """
    from mindstage.knowledge import KnowledgeBase, UnitConventions

    if closure and store is not None:
        cause = "what it derives would be written into what others use"
        raise InvalidArgumentError("the closure", cause=cause, remedy="load the files themselves, without a store")
    listed = _listed(maps)
    if conventions is None or isinstance(conventions, UnitConventions):
        each = [conventions or UnitConventions()] * len(listed)
    else:
        each = list(conventions)
        if len(each) != len(listed):
            cause = f"there are {len(each)} for {len(listed)} maps"
            raise InvalidArgumentError("the conventions", cause=cause, remedy="give one for each map, or one for all")
    knowledge = KnowledgeBase(bundled_ontology=bundled_ontology, store=store, endpoint=endpoint)
    try:
        if len(set(each)) <= 1:  # at once, so that the maps may share what they import
            knowledge.load(
                listed, ontologies=ontologies, urdf_files=robots, conventions=each[0] if each else UnitConventions()
            )
        else:
            for path, own in zip(listed, each, strict=True):
                knowledge.load(path, ontologies=ontologies, urdf_files=robots, conventions=own)
        if closure:
            knowledge.derive()
    except BaseException:
        knowledge.close()
        raise
    return knowledge


def make_simulation(
    knowledge: KnowledgeBase,
    engine: Engine,
    *,
    assets: StrPath | Iterable[StrPath] = (),
    plain_shapes: bool = False,
    timeout_s: float = 10.0,
) -> Simulation:
    """Makes an empty simulation of a knowledge base and an engine, which it owns; bodies get their meshes and shapes.

    Args:
        knowledge: the knowledge base; not closed together with the simulation.
        engine: the engine.
        assets: see `open`.
        plain_shapes: see `open`.
        timeout_s: see `open`.

    Raises:
        SourceParseError: one of the asset folders does not exist.
    """
    from mindstage.saving import mesh_assets
    from mindstage.simulation import Simulation

    if plain_shapes:
        return Simulation(knowledge, engine, timeout_s=timeout_s, shapes=False)
    return Simulation(knowledge, engine, timeout_s=timeout_s, meshes=mesh_assets(assets, knowledge))


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


def _listed(paths: StrPath | Iterable[StrPath]) -> list[StrPath]:
    return [paths] if isinstance(paths, str | os.PathLike) else list(paths)
