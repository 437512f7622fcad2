"""How the viewer opens: one tab compares the controllers, one shows the flight in which the vehicle changes."""

import rerun.blueprint as rrb


def run_blueprint(
    controllers: list[str], commands: tuple[str, ...], reach_m: float, one_flight: bool = False
) -> rrb.Blueprint:
    """Arrange a recording of :func:`auv_torchrl.recording.record_run`.

    Args:
        controllers: out of ``nominal``, ``u_s`` and ``u_t``, those that were flown.
        commands: names of the commands that are shown before and after the map.
        reach_m: how far the starts are from the target, for the camera.
        one_flight: whether there is a flight in which the vehicle changes.
    """
    comparison = _comparison(controllers, commands, reach_m)
    views = rrb.Tabs(comparison, _one_flight(reach_m), active_tab=0) if one_flight else comparison
    return rrb.Blueprint(
        views,
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="playing"),
    )


def _scene(origin: str, name: str, reach_m: float) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        background=[255, 255, 255],
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, color=[0, 0, 0, 40]),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=[-1.0 * reach_m, 1.3 * reach_m, -1.0 * reach_m],
            look_target=[0.0, 0.0, 0.0],
            eye_up=[0.0, 0.0, -1.0],
        ),
    )


def _plot(origin: str, name: str) -> rrb.TimeSeriesView:
    """All of a curve, whatever time is played."""
    whole = rrb.VisibleTimeRange("time", start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite())
    return rrb.TimeSeriesView(origin=origin, name=name, time_ranges=whole, plot_legend=rrb.Corner2D.RightTop)


def _comparison(controllers: list[str], commands: tuple[str, ...], reach_m: float) -> rrb.Horizontal:
    """The vehicles on the left, errors, commands and forces on the right, the map in a tab."""
    adapted = "u_t" in controllers
    maps = rrb.Grid(
        *(_plot(f"commands/{channel}", f"{channel}: before and after the map") for channel in commands),
        grid_columns=2 if len(commands) < 6 else 3,
        name="Commands",
    )
    forces = rrb.Horizontal(
        *(_plot(f"thrust/{name}", f"Thrust in N, {name}") for name in controllers if name != "nominal" or not adapted),
        name="Thrust",
    )
    about = rrb.TextDocumentView(origin="about", name="Result")
    tabs = [rrb.Tabs(maps, forces, *_map_views(adapted), active_tab=0)]
    right = rrb.Vertical(_plot("error", "Position error in m"), *tabs, row_shares=[2, 3])
    left = rrb.Vertical(_scene("world", "Trajectories, NED in m", reach_m), about, row_shares=[2, 1])
    return rrb.Horizontal(left, right, column_shares=[1, 1], name="Controllers compared")


def _one_flight(reach_m: float) -> rrb.Horizontal:
    """The vehicle and what happened on the left, states, error, gains and the detector on the right."""
    left = rrb.Vertical(
        _scene("flight/world", "Flight, NED in m", reach_m),
        rrb.TextLogView(origin="flight/moments", name="What happened"),
        rrb.TextDocumentView(origin="flight/summary", name="Result"),
        row_shares=[3, 1, 1],
    )
    right = rrb.Vertical(
        rrb.StateTimelineView(origin="flight/state", name="Vehicle, adaptation, distance"),
        _plot("flight/error", "Position error in m"),
        _plot("flight/gain", "Gain of each thruster"),
        _plot("flight/statistic", "Detector: sum / threshold"),
        row_shares=[2, 3, 3, 2],
    )
    return rrb.Horizontal(left, right, column_shares=[1, 1.4], name="One flight")


def _map_views(adapted: bool) -> list[rrb.Container]:
    if not adapted:
        return []
    tensor = rrb.TensorView(origin="map/matrix", name="H as an image")
    text = rrb.TextDocumentView(origin="map/text", name="H in numbers")
    return [rrb.Horizontal(text, tensor, name="Map")]
