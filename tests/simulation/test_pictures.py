"""Cameras of pictures and films of simulations."""

from __future__ import annotations

import numpy as np
import pytest

import mindstage as ms
from mindstage.simulation.pictures import ScenePhotographer, flight, turntable


def test_cameras_of_films_keep_their_distance_and_pass_the_stops() -> None:
    with ms.open("bundled:kitchen", engine="null") as sim:
        first = ScenePhotographer.of(sim).first_camera(1.6)
    around = turntable(first, 8)
    assert around[0] == first
    distances = [np.linalg.norm(np.subtract(each.position, each.look_at)) for each in around]
    assert np.allclose(distances, distances[0])
    assert around[4].position[:2] != pytest.approx(first.position[:2], abs=0.5)
    path = flight([around[0], around[2], around[4]], 21)
    assert np.allclose(path[0].position, around[0].position)
    assert np.allclose(path[10].position, around[2].position)
    assert np.allclose(path[-1].position, around[4].position)
