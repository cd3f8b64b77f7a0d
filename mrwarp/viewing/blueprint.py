"""The viewer's layout: robots on the left, plots on the right, ready without a click."""

from __future__ import annotations

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from mrwarp.viewing.robot_view import SERIES, TIMELINE, RobotLogger

CAMERA = (2.0, -2.4, 1.05)
"""Position of the camera relative to the middle of the row [m]; it travels with the robots."""

WINDOW = 3.0
"""Time that the plots show up to the cursor [s]: four and a half strides."""


def make_blueprint(robots: RobotLogger, *, live: bool = False, impact: bool = False) -> rrb.Blueprint:
    """Layout for what a logger shows.

    Args:
        robots: The logger.
        live: Follow the newest data instead of playing from the start.
        impact: Compare the vertical velocity instead of the forward velocity.
    """
    names = robots.names
    velocity = (
        _compare(names, "vertical_velocity")
        if impact
        else _compare(names, "forward_velocity", extra=[f"/robots/{names[0]}/series/forward_velocity_command"])
    )
    right = rrb.Vertical(
        rrb.Horizontal(
            _compare(names, "trunk_height"),
            velocity,
        ),
        # the largest current stands last and has most to show
        rrb.Tabs(*[_details(name, robots) for name in names], active_tab=len(names) - 1, name="joints"),
        row_shares=[1.0, 3.0],
    )
    return rrb.Blueprint(
        rrb.Horizontal(_scene(robots), right, column_shares=[5, 6]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline=TIMELINE,
            play_state="following" if live else "playing",
            loop_mode="off" if live else "all",
        ),
    )


def _scene(robots: RobotLogger) -> rrb.Spatial3DView:
    """The robots on a grid; the camera travels with the one in the middle of the row."""
    middle = len(robots.names) // 2
    y = robots.place(middle)[1]
    return rrb.Spatial3DView(
        origin="/",
        contents=["/robots/**", "- /robots/*/series/**", "- /robots/*/gate/**"],
        name="robots",
        background=rrb.Background(color=[24, 27, 32]),
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, plane=rr.components.Plane3D.XY, color=[120, 130, 140, 90]),
        eye_controls=rrb.EyeControls3D(
            position=[CAMERA[0], y + CAMERA[1], CAMERA[2]],
            look_target=[0.0, y, 0.2],
            tracking_entity=robots.trunk_shape(middle),
        ),
    )


def _compare(names: Sequence[str], series: str, extra: Sequence[str] = ()) -> rrb.TimeSeriesView:
    """One quantity of all robots."""
    return _plot(series, [f"/robots/{name}/series/{series}" for name in names] + list(extra))


def _details(name: str, robots: RobotLogger) -> rrb.Grid:
    """Everything of one robot's joints."""
    shown = [
        s for s in ("mr_torque", "coil_current", "calf_motor_torque", "foot_force", "energy") if s in robots.series
    ]
    views: list[rrb.View] = [_plot(s, [f"/robots/{name}/series/{s}"]) for s in shown]
    if robots.device_legs:
        gates = rrb.StateTimelineView(origin=f"/robots/{name}/gate", name="gates", time_view=_time_axis())
        views.insert(2, gates)
    return rrb.Grid(*views, grid_columns=2, name=name.partition("_")[2].replace("A", " A"))


def _plot(series: str, contents: Sequence[str]) -> rrb.TimeSeriesView:
    kind = SERIES[series]
    return rrb.TimeSeriesView(
        origin="/", contents=list(contents), name=f"{kind.title} [{kind.unit}]", axis_x=_time_axis(),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
    )  # fmt: skip


def _time_axis() -> rrb.archetypes.TimeAxis:
    """The last seconds up to the time shown, in all plots alike."""
    window = rr.TimeRange(
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-WINDOW), end=rr.TimeRangeBoundary.cursor_relative()
    )
    return rrb.archetypes.TimeAxis(link=rrb.components.LinkAxis.Independent, view_range=window)
