"""What every engine must make of forms, as sentences; an engine adds a subclass and an `engine` fixture."""

from __future__ import annotations

import numpy as np
import pytest

from mindstage.engines import Ability, Engine, NoteKind, SpawnReport
from mindstage.world import BodyId, Form, Mobility, Physics, Pose, Solid, SolidKind, difference
from mindstage.world.geometry import rotate, rotation_angle, unit

from .contract import moved, pose_of, pull
from .formed import as_vector, bin_form, case_form, form, plank, solid_form, table_form, wedge_form
from .scenes import FLOOR, LIMIT_M, body, room, slide, world

CRATE = (0.4, 0.4, 0.3)


def forms(**made: Form) -> dict[BodyId, Form]:
    return {BodyId(id): form for id, form in made.items()}


def furnished() -> dict[BodyId, Form]:
    """Forms for the room of all engines' contract: a cabinet, a drawer for the mug, a fridge with a shelf."""
    return forms(
        cabinet=case_form((0.6, 0.6, 1.0)),
        drawer=bin_form((0.58, 0.55, 0.2)),
        fridge=case_form((0.6, 0.6, 1.8), shelves=(0.1,)),
    )


def about(report: SpawnReport, kind: NoteKind) -> set[str]:
    return {id for note in report.notes if note.kind is kind for id in note.ids}


class FormsDescriptionContract:
    """What holds for any engine, with physics or without."""

    def test_a_world_with_forms_comes_back_as_it_was_given(self, engine: Engine) -> None:
        assert engine.spawn(room(), forms=furnished()).ok
        assert difference(room(), engine.log()).identical(0.0)

    def test_a_form_of_a_body_that_is_not_there_does_no_harm(self, engine: Engine) -> None:
        assert engine.spawn(world(FLOOR), forms=forms(ghost=bin_form(CRATE))).ok
        assert engine.poses()[0] == ("floor",)


class FormsContract(FormsDescriptionContract):
    """What holds for any engine in which things fall."""

    rest_m = 0.003
    limit_m = 0.001

    # -- what can be touched

    def test_what_is_dropped_into_an_open_box_lies_on_its_floor(self, engine: Engine) -> None:
        ball = body("ball", (0.05, 0.03, 0.6), (0.08, 0.08, 0.08), "dynamic", 0.2)
        engine.spawn(
            world(FLOOR, body("crate", (0, 0, 0.15), CRATE), ball),
            forms=forms(crate=bin_form(CRATE), ball=solid_form(SolidKind.SPHERE, (0.08, 0.08, 0.08))),
        )
        engine.step(3.0)
        assert pose_of(engine, "ball")[2] == pytest.approx(0.02 + 0.04, abs=self.rest_m)

    def test_nobody_touches_the_free_room_under_a_table(self, engine: Engine) -> None:
        report = engine.spawn(
            world(
                FLOOR,
                body("table", (0, 0, 0.35), (1.2, 0.8, 0.7)),
                body("box", (0, 0, 0.1), (0.2, 0.2, 0.2), "dynamic", 1.0),
                body("mug", (0, 0, 0.75), (0.08, 0.08, 0.1), "dynamic", 0.3),
            ),
            forms=forms(table=table_form((1.2, 0.8, 0.7))),
        )
        assert not about(report, NoteKind.OVERLAP) | about(report, NoteKind.HOLLOW)
        pull(engine, "box", (0.0, 12.0, 0.0), 1.5)
        assert pose_of(engine, "box")[1] > 0.5
        assert pose_of(engine, "mug")[2] == pytest.approx(0.75, abs=self.rest_m)

    @pytest.mark.parametrize(
        ("kind", "size", "turn", "height"),
        [
            (SolidKind.CYLINDER, (0.2, 0.2, 0.1), (1.0, 0, 0, 0), 0.05),
            (SolidKind.CYLINDER, (0.2, 0.2, 0.3), (0.7071067811865476, 0.7071067811865476, 0, 0), 0.1),
            (SolidKind.SPHERE, (0.2, 0.2, 0.2), (1.0, 0, 0, 0), 0.1),
            (SolidKind.BOX, (0.2, 0.2, 0.1), (0.7071067811865476, 0.7071067811865476, 0, 0), 0.1),
        ],
    )
    def test_each_kind_of_solid_rests_as_high_as_it_is(
        self, engine: Engine, kind: SolidKind, size: tuple[float, float, float], turn: tuple[float, ...], height: float
    ) -> None:
        thing = body("thing", (0, 0, height + 0.05), size, "dynamic", 1.0, quaternion=turn)
        engine.spawn(world(FLOOR, thing), forms=forms(thing=solid_form(kind, size)))
        engine.step(2.0)
        assert pose_of(engine, "thing")[2] == pytest.approx(height, abs=self.rest_m)

    def test_a_hull_has_slopes(self, engine: Engine) -> None:
        size = (0.6, 0.4, 0.3)
        thing = body("thing", (0.15, 0, 0.6), (0.1, 0.1, 0.1), "dynamic", 0.5)
        report = engine.spawn(
            world(FLOOR, body("ramp", (0, 0, 0.15), size), thing),
            forms=forms(ramp=wedge_form(size), thing=solid_form(SolidKind.SPHERE, (0.1, 0.1, 0.1))),
        )
        assert report.ok
        engine.step(2.0)
        assert pose_of(engine, "thing")[0] < -0.3, "it did not roll down"

    def test_a_form_of_no_solids_can_be_walked_through(self, engine: Engine) -> None:
        engine.spawn(
            world(FLOOR, body("light", (0, 0, 0.5), (1, 1, 0.1)), body("box", (0, 0, 1), (0.2,) * 3, "dynamic", 1.0)),
            forms=forms(light=form()),
        )
        engine.step(2.0)
        assert pose_of(engine, "box")[2] == pytest.approx(0.1, abs=self.rest_m)

    def test_solids_of_no_meaning_are_left_out_and_it_is_said(self, engine: Engine) -> None:
        broken = form(
            Solid(size=(float("nan"), 1.0, 1.0)),
            plank((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1)),
            friction=float("nan"),
            density=-5.0,
        )
        box = body("box", (0, 0, 1), (0.2, 0.2, 0.2), "dynamic", 1.0)
        report = engine.spawn(world(FLOOR, box), forms=forms(box=broken))
        assert about(report, NoteKind.SHAPE) == {"box"}
        engine.step(2.0)
        assert pose_of(engine, "box")[2] == pytest.approx(0.1, abs=self.rest_m)

    # -- who collides with whom

    def test_boxes_that_overlap_only_as_boxes_still_collide(self, engine: Engine) -> None:
        """One crate stands in the free half of another one: the two never let each other through."""
        small, large = (0.2, 0.2, 0.3), (0.6, 0.4, 0.3)
        report = engine.spawn(
            world(
                FLOOR,
                body("large", (0, 0, 0.15), large),
                body("small", (0.05, 0, 0.17), small, "dynamic", 1.0),
            ),
            forms=forms(large=bin_form(large), small=bin_form(small)),
        )
        assert not about(report, NoteKind.OVERLAP)
        pull(engine, "small", (15.0, 0.0, 0.0), 2.0)
        place = pose_of(engine, "small")
        assert 0.1 < place[0] < 0.22, "it tilts against the wall of the other one and goes no further"
        assert place[2] > 0.1

    def test_solids_that_stand_in_one_another_do_not_explode_and_it_is_said(self, engine: Engine) -> None:
        report = engine.spawn(
            world(
                body("one", (0, 0, 1), CRATE, "dynamic", 2.0, gravity=False),
                body("two", (0.1, 0.1, 1.05), CRATE, "dynamic", 2.0, gravity=False),
            ),
            forms=forms(one=bin_form(CRATE), two=bin_form(CRATE)),
        )
        assert about(report, NoteKind.OVERLAP) == {"one", "two"}
        engine.step(1.0)
        assert moved(engine, "one", np.array([0, 0, 1.0])) < 1e-4

    def test_what_is_sunk_in_what_it_stands_on_is_pushed_out_and_it_is_said(self, engine: Engine) -> None:
        """A map puts things on the undersides of boxes; the floor of a form is thicker than nothing."""
        mug = body("mug", (0, 0, 0.015 + 0.05), (0.08, 0.08, 0.1), "dynamic", 0.3)
        report = engine.spawn(world(FLOOR, body("crate", (0, 0, 0.15), CRATE), mug), forms=forms(crate=bin_form(CRATE)))
        assert about(report, NoteKind.SUNK) == {"mug", "crate"}
        assert not about(report, NoteKind.OVERLAP)
        engine.step(2.0)
        place = pose_of(engine, "mug")
        assert place[2] == pytest.approx(0.02 + 0.05, abs=self.rest_m)
        assert abs(place[0]) < 0.002
        assert abs(place[1]) < 0.002

    def test_a_form_is_not_made_hollow_again(self, engine: Engine) -> None:
        report = engine.spawn(room(), forms=furnished())
        assert not about(report, NoteKind.HOLLOW)
        assert "drawer" not in about(report, NoteKind.OVERLAP)

    # -- what is inside stays inside

    def test_a_mug_stays_in_its_drawer_through_opening_and_closing(self, engine: Engine) -> None:
        engine.spawn(room(), forms=furnished())
        engine.step(1.0)  # it stands 2 cm over the drawer's floor
        for force, place in ((15.0, LIMIT_M), (-15.0, -LIMIT_M)):
            pull(engine, "drawer_handle", (force, 0.0, 0.0), 4.0)
            engine.step(1.0)
            drawer, mug = pose_of(engine, "drawer"), pose_of(engine, "mug")
            assert drawer[0] == pytest.approx(place, abs=self.limit_m)
            assert abs(mug[0] - drawer[0]) < 0.29
            assert abs(mug[1] - drawer[1]) < 0.275
            assert 0.2 + 0.02 < mug[2] < 0.3

    def test_milk_stands_on_its_shelf_while_the_door_swings(self, engine: Engine) -> None:
        milk = body("milk", (0, 2, 1.1), (0.08, 0.08, 0.2), "dynamic", 1.0)
        described = world(*room().bodies, milk, *room().constraints, *room().attachments)
        report = engine.spawn(described, forms=furnished())
        assert not about(report, NoteKind.HOLLOW)
        pull(engine, "door_handle", (25.0, 0.0, 0.0), 4.0)
        assert rotation_angle(pose_of(engine, "door")[3:], [1, 0, 0, 0]) > 0.7
        assert moved(engine, "milk", np.array([0, 2, 1.1])) < self.rest_m

    # -- mass

    def test_the_mass_of_a_hollow_body_stays_the_maps(self, engine: Engine) -> None:
        crate = body("crate", (0, 0, 0), CRATE, "dynamic", 2.5, gravity=False)
        engine.spawn(world(crate), forms=forms(crate=bin_form(CRATE, density=700.0)))
        for _ in range(50):
            engine.push(BodyId("crate"), (5.0, 0.0, 0.0))
            engine.step(0.02)
        assert pose_of(engine, "crate")[0] == pytest.approx(0.5 * (5.0 / 2.5) * 1.0**2, rel=0.01)
        assert rotation_angle(pose_of(engine, "crate")[3:], [1, 0, 0, 0]) < 1e-3, "not pushed where its mass is"

    def test_without_a_mass_what_it_is_made_of_tells_it(self, engine: Engine) -> None:
        crate = body("crate", (0, 0, 1), CRATE, "dynamic", None, gravity=False)
        report = engine.spawn(world(crate), forms=forms(crate=bin_form(CRATE, density=700.0)))
        note = next(note for note in report.notes if note.kind is NoteKind.MASS_ESTIMATED)
        floor, ends, sides = 0.4 * 0.4 * 0.02, 0.02 * 0.4 * 0.28, 0.36 * 0.02 * 0.28
        mass = 700.0 * (floor + 2 * ends + 2 * sides)
        assert f"{mass:.3g} kg" in note.text
        for _ in range(50):
            engine.push(BodyId("crate"), (2 * mass, 0.0, 0.0))
            engine.step(0.02)
        assert pose_of(engine, "crate")[0] == pytest.approx(1.0, rel=0.01)

    def test_a_body_tips_over_to_where_its_mass_is(self, engine: Engine) -> None:
        """A foot with a heavy arm: its box would stand, the arm pulls it over."""
        size = (0.6, 0.1, 0.4)
        arm = form(
            plank((-0.3, -0.05, -0.2), (-0.2, 0.05, 0.2)),
            plank((-0.2, -0.05, 0.1), (0.3, 0.05, 0.2)),
        )
        engine.spawn(world(FLOOR, body("arm", (0, 0, 0.201), size, "dynamic", 3.0)), forms=forms(arm=arm))
        engine.step(2.0)
        assert rotation_angle(pose_of(engine, "arm")[3:], [1, 0, 0, 0]) > 0.3

    # -- surfaces

    @pytest.mark.parametrize(("friction", "slides"), [(0.9, False), (0.2, True)])
    def test_a_steep_ramp_holds_what_is_rough_and_not_what_is_smooth(
        self, engine: Engine, friction: float, slides: bool
    ) -> None:
        turn = unit([np.cos(np.radians(15)), 0.0, -np.sin(np.radians(15)), 0.0])  # 30 degrees
        up = rotate(turn, [0.0, 0.0, 0.02 + 0.05 + 0.0005])
        size = (2.0, 0.6, 0.04)
        engine.spawn(
            world(
                body("ramp", (0, 0, 1), size, quaternion=tuple(turn.tolist())),
                body(
                    "box",
                    as_vector(up + np.array([0.0, 0.0, 1.0])),
                    (0.2, 0.2, 0.1),
                    "dynamic",
                    1.0,
                    quaternion=tuple(turn.tolist()),
                ),
            ),
            forms=forms(
                ramp=solid_form(SolidKind.BOX, size, friction=friction),
                box=solid_form(SolidKind.BOX, (0.2, 0.2, 0.1), friction=friction),
            ),
        )
        before = pose_of(engine, "box")
        engine.step(0.5)
        way = moved(engine, "box", before)
        expected = 0.5 * 9.81 * (0.5 - friction * np.cos(np.radians(30))) * 0.5**2
        assert way == pytest.approx(expected, rel=0.15) if slides else way < 0.01

    def test_what_is_bouncy_jumps_and_what_is_not_lies_still(self, engine: Engine) -> None:
        size = (0.1, 0.1, 0.1)
        balls = [body(name, (x, 0, 1.0), size, "dynamic", 0.2) for name, x in (("rubber", 0.0), ("clay", 1.0))]
        engine.spawn(
            world(FLOOR, *balls),
            forms=forms(
                rubber=solid_form(SolidKind.SPHERE, size, restitution=0.8),
                clay=solid_form(SolidKind.SPHERE, size, restitution=0.0),
            ),
        )
        highest = dict.fromkeys(("rubber", "clay"), 0.0)
        engine.step((2 * 0.95 / 9.81) ** 0.5 + 0.1)  # by now both have hit the floor
        for _ in range(60):
            engine.step(0.01)
            highest = {id: max(height, float(pose_of(engine, id)[2])) for id, height in highest.items()}
        assert highest["rubber"] == pytest.approx(0.05 + 0.8**2 * 0.95, abs=0.1)
        assert highest["clay"] < 0.08

    # -- edits

    def test_a_form_goes_where_its_body_goes_and_stays_through_edits(self, engine: Engine) -> None:
        ball = body("ball", (0, 0, 0.8), (0.08, 0.08, 0.08), "dynamic", 0.2)
        engine.spawn(
            world(FLOOR, body("crate", (2, 0, 0.15), CRATE, "kinematic"), body("other", (5, 5, 1), (1, 1, 1)), ball),
            forms=forms(crate=bin_form(CRATE), ball=solid_form(SolidKind.SPHERE, (0.08, 0.08, 0.08))),
        )
        engine.set_pose(BodyId("crate"), Pose((0, 0, 0.15)))
        engine.delete([BodyId("other")])
        engine.set_physics(BodyId("crate"), Physics(mobility=Mobility.STATIC))
        engine.spawn(world(body("new", (6, 6, 1), (0.2, 0.2, 0.2), "dynamic", 1.0)))
        engine.attach(BodyId("floor"), BodyId("crate"))
        engine.detach(BodyId("crate"))
        engine.step(3.0)
        assert pose_of(engine, "ball")[2] == pytest.approx(0.06, abs=self.rest_m)

    def test_a_form_comes_back_with_a_saved_state(self, engine: Engine) -> None:
        if Ability.SAVE not in engine.abilities:
            pytest.skip("the engine has no SAVE ability")
        engine.spawn(room(), forms=furnished())
        state = engine.save()
        engine.clear()
        engine.restore(state)
        pull(engine, "drawer_handle", (15.0, 0.0, 0.0), 4.0)
        drawer, mug = pose_of(engine, "drawer"), pose_of(engine, "mug")
        assert drawer[0] == pytest.approx(LIMIT_M, abs=self.limit_m)
        assert abs(mug[0] - drawer[0]) < 0.29

    def test_a_body_spawned_anew_has_its_new_form_or_none(self, engine: Engine) -> None:
        mug = body("mug", (0, 0, 0.8), (0.08, 0.08, 0.1), "dynamic", 0.3)
        crate = world(body("crate", (0, 0, 0.15), CRATE))
        engine.spawn(world(FLOOR))
        for made, height in ((forms(crate=bin_form(CRATE)), 0.07), ({}, 0.35)):
            engine.spawn(crate, forms=made)
            engine.spawn(world(mug))
            engine.step(2.0)
            assert pose_of(engine, "mug")[2] == pytest.approx(height, abs=self.rest_m)
            engine.delete([BodyId("crate"), BodyId("mug")])

    def test_a_room_of_forms_left_alone_stays(self, engine: Engine) -> None:
        described = room()
        resting = [b for b in described.bodies if b.id not in {"crate", "mug"}]
        mug = body("mug", (0.05, 0.1, 0.271), (0.08, 0.08, 0.1), "dynamic", 0.3)
        engine.spawn(world(*resting, mug, *described.constraints, *described.attachments), forms=furnished())
        ids, before = engine.poses()
        engine.step(10.0)
        worst = np.linalg.norm(engine.poses()[1][:, :3] - before[:, :3], axis=1)
        assert worst.max() < 0.01, ids[int(worst.argmax())]

    # -- furniture that stands close

    def test_drawers_without_a_gap_between_them_slide_past_each_other(self, engine: Engine) -> None:
        size = (0.55, 0.6, 0.2)
        case = body("case", (0, 0, 0.4), (0.57, 0.64, 0.64))
        drawers = [body(f"drawer{i}", (0.01, 0, 0.2 + 0.2 * i), size, "dynamic", 4.0) for i in range(3)]
        slides = [slide(f"slide{i}", "case", f"drawer{i}", (0.0, 0, 0.2 + 0.2 * i)) for i in range(3)]
        made = forms(case=case_form((0.57, 0.64, 0.64))) | {BodyId(f"drawer{i}"): bin_form(size) for i in range(3)}
        engine.spawn(world(FLOOR, case, *drawers, *slides), forms=made)
        for i in range(3):
            pull(engine, f"drawer{i}", (25.0, 0.0, 0.0), 2.0)
            assert pose_of(engine, f"drawer{i}")[0] == pytest.approx(0.01 + LIMIT_M, abs=self.limit_m)

    def test_a_door_swings_although_its_neighbour_touches_it(self, engine: Engine) -> None:
        """The edge of a door that is hinged at its front goes outwards a little when it turns."""
        panel = form(plank((-0.02, -0.3, -0.9), (0.02, 0.3, 0.9)))
        neighbour = body("neighbour", (0.322, 1.4, 0.9), (0.04, 0.6, 1.8))
        described = room()
        others = [b for b in described.bodies if b.id not in {"crate", "mug"}]
        parts = world(*others, neighbour, *described.constraints, *described.attachments)
        engine.spawn(parts, forms=furnished() | forms(door=panel, neighbour=panel))
        pull(engine, "door_handle", (25.0, 0.0, 0.0), 4.0)
        assert rotation_angle(pose_of(engine, "door")[3:], [1, 0, 0, 0]) == pytest.approx(np.pi / 4, abs=0.01)
