"""Panel: the buttons and words beside the view."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import viser

from mindstage.stage import Frame, Lit, Stage
from mindstage.viewport.details import fault_html, hint_html, legend_html, status_html
from mindstage.viewport.palette import local_name
from mindstage.world import Body, BodyId

__all__ = ["Panel"]

_SPEEDS = {"0.25 x": 0.25, "0.5 x": 0.5, "1 x": 1.0, "2 x": 2.0, "5 x": 5.0}
_STEP_S = 0.1
"""How much time one press of the button lets pass: enough to see something move."""
_MOST_FOUND = 60
_HINT = "Click a thing to name it. Drag a door, a drawer or anything loose to pull it; drag elsewhere to look around."
_NOTHING = "Nothing is selected."


class Panel:
    """What stands in the panel; it asks the stage for what its buttons say."""

    def __init__(
        self,
        server: viser.ViserServer,
        stage: Stage,
        *,
        choose: Callable[[BodyId | None], None],
        show_shells: Callable[[bool], None],
        guard: Callable[[Callable[..., None]], Callable[..., None]],
    ) -> None:
        """Fills the panel.

        Args:
            server: where the visitors come.
            stage: what the buttons act on.
            choose: called with the body that a visitor selects.
            show_shells: called when a visitor wants to see the outlines of shells, or not.
            guard: wraps each reaction so that what it raises is reported.
        """
        self._stage, self._choose, self._show_shells = stage, choose, show_shells
        self._bodies: dict[BodyId, Body] = {}
        self._found_ids: dict[str, BodyId] = {}
        gui = server.gui
        self._status = gui.add_html("")
        self._fault = gui.add_html("", visible=False)
        self._legend = gui.add_html("", visible=False)
        self._put_out = gui.add_button("Put out the lights", visible=False)
        self._time = gui.add_button_group("Time", ("Play", "Pause", "Step", "Reset"))
        self._speed = gui.add_dropdown("Speed", tuple(_SPEEDS), initial_value="1 x")
        self._find = gui.add_text("Find", "", hint="By a part of an id, a name or a class.")
        self._found = gui.add_dropdown("Found", ("",), visible=False)
        self._shells = gui.add_checkbox("Outlines", True, hint="Of what encloses the whole place.", visible=False)
        gui.add_divider()
        self._details = gui.add_html(hint_html(_NOTHING))
        gui.add_divider()
        gui.add_html(hint_html(_HINT))
        self._put_out.on_click(guard(lambda event: self._stage.put_out()))
        self._time.on_click(guard(self._press))
        self._speed.on_update(guard(self._change_speed))
        self._find.on_update(guard(self._search))
        self._found.on_update(guard(self._pick))
        self._shells.on_update(guard(lambda event: self._show_shells(self._shells.value)))

    # -- what it shows ---------------------------------------------------------------------------------------

    def show_frame(self, frame: Frame) -> None:
        """The line about the world."""
        self._status.content = status_html(frame, engine=self._stage.engine_name)
        speed = next((name for name, speed in _SPEEDS.items() if speed == frame.speed), None)
        if frame.playing and speed is not None:
            self._speed.value = speed  # type: ignore[misc]  # it has a setter, which mypy does not see

    def show_lit(self, groups: Sequence[Lit]) -> None:
        """What is lit, and why."""
        self._legend.content = legend_html(groups, self._bodies)
        self._legend.visible = self._put_out.visible = bool(groups)

    def show_body(self, html: str) -> None:
        """What is selected; nothing, if it is empty."""
        self._details.content = html or hint_html(_NOTHING)

    def show_fault(self, text: str) -> None:
        """Something that went wrong, until it is called with nothing."""
        self._fault.content, self._fault.visible = fault_html(text), bool(text)

    def know(self, bodies: dict[BodyId, Body], *, has_shells: bool) -> None:
        """What can be found."""
        self._bodies = bodies
        self._shells.visible = has_shells

    # -- what visitors do ------------------------------------------------------------------------------------

    def _press(self, event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
        match event.target.value:
            case "Play":
                self._stage.play(speed=_SPEEDS[self._speed.value])
            case "Pause":
                self._stage.pause()
            case "Step":
                self._stage.pause()
                self._stage.step(_STEP_S)
            case "Reset":
                self._stage.reset()

    def _change_speed(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        # Without a visitor it was the page itself, following the stage.
        if event.client is not None and self._stage.frame.playing:
            self._stage.play(speed=_SPEEDS[event.target.value])

    def _search(self, event: viser.GuiEvent[viser.GuiTextHandle]) -> None:
        text = event.target.value.strip().casefold()
        matches = [body for body in self._bodies.values() if text and text in _searched(body)]
        self._found_ids = {f"{body.id} · {local_name(body.cls)}": body.id for body in matches[:_MOST_FOUND]}
        count = f"{len(matches)} found" if matches else "nothing of that name"
        self._found.visible = bool(text)
        self._found.options = (count, *self._found_ids)
        self._found.value = count  # type: ignore[misc]
        if len(matches) == 1:
            self._choose(matches[0].id)

    def _pick(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        if event.client is not None and (id := self._found_ids.get(event.target.value)) is not None:
            self._choose(id)


def _searched(body: Body) -> str:
    return f"{body.id} {local_name(body.cls)} {body.label or ''}".casefold()
