"""How the viewer opens: the vehicles on the left, errors, commands and forces on the right, the map in a tab."""

import rerun.blueprint as rrb


def run_blueprint(controllers: list[str], commands: tuple[str, ...], reach_m: float) -> rrb.Blueprint:
    """Arrange a recording of :func:`auv_torchrl.recording.record_run`.

    Args:
        controllers: out of ``nominal``, ``u_s`` and ``u_t``, those that were flown.
        commands: names of the commands that are shown before and after the map.
        reach_m: how far the starts are from the target, for the camera.
    """
    adapted = "u_t" in controllers
    scene = rrb.Spatial3DView(
        origin="world",
        name="Trajectories, NED in m",
        background=[255, 255, 255],
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, color=[0, 0, 0, 40]),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=[-1.0 * reach_m, 1.3 * reach_m, -1.0 * reach_m],
            look_target=[0.0, 0.0, 0.0],
            eye_up=[0.0, 0.0, -1.0],
        ),
    )
    whole = rrb.VisibleTimeRange(
        "time",
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.infinite(),
    )

    def plot(origin: str, name: str) -> rrb.TimeSeriesView:
        return rrb.TimeSeriesView(origin=origin, name=name, time_ranges=whole, plot_legend=rrb.Corner2D.RightTop)

    maps = rrb.Grid(
        *(plot(f"commands/{channel}", f"{channel}: before and after the map") for channel in commands),
        grid_columns=2 if len(commands) < 6 else 3,
        name="Commands",
    )
    forces = rrb.Horizontal(
        *(plot(f"thrust/{name}", f"Thrust in N, {name}") for name in controllers if name != "nominal" or not adapted),
        name="Thrust",
    )
    about = rrb.TextDocumentView(origin="about", name="Result")
    tabs = [rrb.Tabs(maps, forces, *_map_views(adapted), active_tab=0)]
    right = rrb.Vertical(plot("error", "Position error in m"), *tabs, row_shares=[2, 3])
    left = rrb.Vertical(scene, about, row_shares=[2, 1])
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[1, 1]),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="playing"),
    )


def _map_views(adapted: bool) -> list[rrb.Container]:
    if not adapted:
        return []
    tensor = rrb.TensorView(origin="map/matrix", name="H as an image")
    text = rrb.TextDocumentView(origin="map/text", name="H in numbers")
    return [rrb.Horizontal(text, tensor, name="Map")]
