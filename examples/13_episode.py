"""Record an episode, then ask it what happened, and continue from one of its moments."""

import tempfile
from pathlib import Path

import mindstage as ms
from mindstage.episodes import Episode, Recorder

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "run.mcap"
    with ms.open("bundled:kitchen") as sim, Recorder(sim, path):
        sim.step(0.3)
        sim.joint("fridge_door").open()
        sim.place("milk_carton_1", on="table")
        sim.step(0.5)

    with Episode(path) as episode:
        knowledge = episode.knowledge()
        knowledge.add_episode(episode)
        for event in knowledge.ask("occurs", "Opening"):
            print(f"{event.thing} was opened from {event.begin:.1f} to {event.end:.1f} s")
        for at in (0.1, episode.end_s):
            inside = [row.other for row in knowledge.ask("where_is", "milk_carton_1", relation="inside", at=at)]
            print(f"at {at:.1f} s the milk is in", inside or "nothing")
        with episode.resume(1.0) as sim:
            print(f"continued: the door is open by {sim.joint('fridge_door').openness:.0%}")
