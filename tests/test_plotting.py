"""Figures: what is drawn where, and what is refused.  How they look is for eyes."""

import control as ct
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.patches import Polygon

import control_kpos as kp

CONE, LEVELS, TRAJECTORIES, DIRECTION = 4, 5, 6, 7
WINDOW = [-1, 2, -5, 5]


@pytest.fixture
def node():
    return kp.examples.mass_spring_node(name="node")


def area(corners):
    x, y = corners.T
    return abs(x @ np.roll(y, 1) - y @ np.roll(x, 1)) / 2


def test_portrait_is_a_control_plot_with_labels(node):
    cplt = kp.phase_portrait(node, pointdata=WINDOW)
    ax = cplt.axes[0, 0]
    assert isinstance(cplt, ct.ControlPlot)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("position", "velocity")
    assert [*ax.get_xlim(), *ax.get_ylim()] == WINDOW
    assert cplt.figure.get_suptitle() == "Phase portrait for node"
    assert cplt.lines.shape == (8,)
    cplt.figure.canvas.draw()


def test_cone_is_shaded_below_everything(node):
    cplt = kp.phase_portrait(node, pointdata=WINDOW)
    patch = cplt.lines[CONE][0]
    assert isinstance(patch, Polygon)
    assert patch.get_zorder() == 0 < min(line.get_zorder() for line in cplt.axes[0, 0].lines)
    corners = patch.get_xy()[:-1]
    assert node.X.contains(corners).all()
    # x >= 0, y >= -2x within [-1, 2] x [-5, 5]: 2 x 5 above the axis, the triangle (2, 0), (2, -4) below it
    assert area(corners) == pytest.approx(14)


@pytest.mark.parametrize("X", [[[1, 0], [0, 1]], [[1, 1], [-1, 1]], [[1, -1], [1, 1]], [[-1, -3], [0, -1]]])
def test_shaded_region_is_the_cone_in_the_window(X):
    X = kp.PolyhedralCone(X)
    patch = kp.phase_portrait(-np.eye(2), X=X, pointdata=[-1, 1, -2, 1]).lines[CONE][0]
    grid = np.stack(np.meshgrid(np.linspace(-0.98, 0.98, 23), np.linspace(-1.97, 0.97, 29)), axis=-1).reshape(-1, 2)
    drawn = patch.get_path().contains_points(grid)
    boundary = np.abs(grid @ X.facets.T).min(axis=1) < 1e-6
    np.testing.assert_array_equal(drawn[~boundary], X.contains(grid)[~boundary])


def test_level_lines_are_level_inside_the_cone(node):
    cplt = kp.phase_portrait(node, pointdata=WINDOW)
    v = node.linear_lyapunov().v
    levels = []
    for line in cplt.lines[LEVELS]:
        ends = line.get_xydata()
        assert node.X.contains(ends * (1 + 1e-9) + 1e-9 * node.X.interior_point).all()
        levels.append(ends @ v)
    levels = np.array(levels)
    np.testing.assert_allclose(levels[:, 0], levels[:, 1])
    assert (np.diff(levels[:, 0]) > 0).all()


def test_trajectories_are_solutions_inside_the_cone(node):
    cplt = kp.phase_portrait(node, pointdata=WINDOW, timedata=1.0)
    assert len(cplt.lines[TRAJECTORIES]) == 5
    for line in cplt.lines[TRAJECTORIES]:
        path = line.get_xydata()
        response = ct.initial_response(node, [0, 1.0], path[0])
        np.testing.assert_allclose(path[-1], response.states[:, -1], atol=1e-6)
        assert (path @ node.X.facets.T >= -1e-9).all()


def test_start_of_trajectories_can_be_chosen(node):
    lines = kp.phase_portrait(node, initial_states=[[0.5, 0.5], [0.5, -0.5]]).lines[TRAJECTORIES]
    np.testing.assert_array_equal([line.get_xydata()[0] for line in lines], [[0.5, 0.5], [0.5, -0.5]])


def test_unstable_or_not_positive_systems_have_no_level_lines():
    assert not kp.phase_portrait([[1, 1], [1, 1]]).lines[LEVELS]
    assert not kp.phase_portrait([[0, -1], [1, -1]]).lines[LEVELS]


def test_a_given_vector_has_level_lines_of_its_own(node):
    lines = kp.phase_portrait(node, level_lines=[5.09, 0.836]).lines[LEVELS]
    ends = lines[0].get_xydata() @ [5.09, 0.836]
    assert ends[0] == pytest.approx(ends[1])
    with pytest.raises(kp.ConeMismatchError, match="level_lines"):
        kp.phase_portrait(node, level_lines=[-1, 0])


def test_dominant_direction_is_the_slow_eigenvector(node):
    assert not kp.phase_portrait(node).lines[DIRECTION]
    (line,) = kp.phase_portrait(node, dominant_direction=True).lines[DIRECTION]
    x, y = line.get_xydata()[1]
    assert y / x == pytest.approx(-2)
    rotation = kp.phase_portrait([[0, -1], [1, 0]], dominant_direction=True)
    assert not rotation.lines[DIRECTION]


def test_discrete_time_draws_orbits():
    A = np.array([[0.6, 0.2], [0.1, 0.7]])
    sys = kp.ConeStateSpace(A, [[0], [1]], [[1, 0]], 0, 0.5)
    for line in kp.phase_portrait(sys, timedata=2.0).lines[TRAJECTORIES]:
        path = line.get_xydata()
        assert len(path) == 5
        np.testing.assert_allclose(path[1:], path[:-1] @ A.T)
    with pytest.raises(TypeError, match="plot_vectorfield"):
        kp.phase_portrait(sys, plot_vectorfield=True)


def test_a_cone_over_a_portrait_keeps_its_frame(node):
    ax = kp.phase_portrait(node, WINDOW).axes[0, 0]
    kp.plot_cone(kp.orthant(2), ax=ax)
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_aspect()) == ("position", "velocity", "auto")
    assert [*ax.get_xlim(), *ax.get_ylim()] == WINDOW


def test_arguments_come_in_the_order_of_python_control(node):
    cplt = kp.phase_portrait(node, WINDOW, 0.5)
    assert [*cplt.axes[0, 0].get_xlim(), *cplt.axes[0, 0].get_ylim()] == WINDOW
    plt.figure()
    assert kp.phase_portrait(ct.ss(node), X=node.X).lines[CONE]


def test_draws_into_given_axes(node):
    figure, axes = plt.subplots(1, 2)
    cplt = kp.phase_portrait(node, ax=axes[1], title="right", plot_vectorfield=True)
    assert cplt.figure is figure
    assert cplt.axes[0, 0] is axes[1]
    assert axes[1].get_title() == "right"
    assert not axes[0].has_data()
    assert cplt.lines[1] is not None


def test_default_axes_are_those_of_python_control(node):
    first = kp.phase_portrait(node)
    assert kp.phase_portrait(node).figure is first.figure  # a single axes is drawn into
    plt.subplots(1, 2)
    assert kp.phase_portrait(node).figure is not plt.figure(2)


def test_legend_stands_outside_the_data(node):
    cplt = kp.phase_portrait(node)
    cplt.figure.canvas.draw()
    legend, ax = cplt.legend.get_window_extent(), cplt.axes[0, 0].get_window_extent()
    assert legend.y1 < ax.y0
    assert kp.phase_portrait(node, show_legend=False).legend is None


def test_stiff_and_singular_systems_are_drawn():
    for A in (
        [[-1e6, 0], [0, -1]],
        [[0, 0], [0, 0]],
        [[0, 1], [0, 0]],
        [[-1e-9, 50], [-50, -1e-9]],
        [[300, 0], [0, -1]],
    ):
        cplt = kp.phase_portrait(A)
        assert all(np.isfinite(line.get_xydata()).all() for line in cplt.lines[TRAJECTORIES])
        cplt.figure.canvas.draw()


def test_window_without_the_origin_is_drawn(node):
    assert kp.phase_portrait(node, pointdata=[1, 2, 1, 2]).lines[CONE]
    assert not kp.phase_portrait(node, pointdata=[-2, -1, -1, 1]).lines[CONE]


@pytest.mark.parametrize(
    ("error", "match", "arguments"),
    [
        (kp.ShapeError, "two states", {"sys": [[1.0]]}),
        (kp.ShapeError, "two states", {"sys": ct.ss(-np.eye(3), np.eye(3), np.eye(3), 0)}),
        (kp.ConeMismatchError, "X", {"sys": -np.eye(2), "X": kp.orthant(3)}),
        (kp.NotProperConeError, "X", {"sys": -np.eye(2), "X": kp.PolyhedralCone([[1, 0]])}),
        (kp.ShapeError, "pointdata", {"sys": -np.eye(2), "pointdata": [1, 0, 0, 1]}),
        (kp.ShapeError, "pointdata", {"sys": -np.eye(2), "pointdata": [1, 0]}),
        (kp.DataError, "pointdata", {"sys": -np.eye(2), "pointdata": [0, 1, 0, np.nan]}),
        (kp.DataError, "timedata", {"sys": -np.eye(2), "timedata": -1}),
        (kp.ShapeError, "initial_states", {"sys": -np.eye(2), "initial_states": [1, 2, 3]}),
        (kp.DataError, "sys", {"sys": [[np.nan, 0], [0, 1]]}),
        (TypeError, "nonsense", {"sys": -np.eye(2), "nonsense": 1}),
    ],
)
def test_bad_input_is_refused(error, match, arguments):
    with pytest.raises(error, match=match):
        kp.phase_portrait(**arguments)


# -- cones alone


def test_cone_in_the_plane_is_a_sector():
    cplt = kp.plot_cone(kp.examples.paper_cone(), title="cone")
    rays, (sector,) = cplt.lines
    assert len(rays) == 2
    opening = np.arccos(-2 / np.sqrt(5))
    assert area(sector.get_xy()[:-1]) == pytest.approx(opening / 2, rel=1e-3)
    assert cplt.figure.get_suptitle() == "cone"


def test_cone_in_space_has_its_rays_and_walls():
    X = kp.lorentz(3, facets=10)
    cplt = kp.plot_cone(X, size=2.0)
    rays = cplt.lines[0]
    ends = np.array([np.array(ray.get_data_3d())[:, 1] for ray in rays])
    lengths = np.linalg.norm(ends, axis=1)
    assert lengths.max() == pytest.approx(2.0)
    assert kp.PolyhedralCone(ends).n_rays == X.n_rays == len(rays)
    # neighbours in the ring span a facet: some normal is zero on both
    slack = np.abs(ends @ X.facets.T) / (lengths[:, None] * np.linalg.norm(X.facets, axis=1))
    together = (slack < 1e-9) & (np.roll(slack, -1, axis=0) < 1e-9)
    assert together.any(axis=1).all()
    cplt.figure.canvas.draw()


def test_cones_on_the_same_axes_differ_in_more_than_colour():
    X = kp.examples.paper_cone()
    ax = kp.plot_cone(X, label="X").axes[0, 0]
    cplt = kp.plot_cone(X.dual, ax, label="dual")
    (first, *_), (second, *_) = (line for line in [ax.lines[:2], cplt.lines[0]])
    assert first.get_color() != second.get_color()
    assert first.get_linestyle() != second.get_linestyle()
    assert [text.get_text() for text in cplt.legend.get_texts()] == ["X", "dual"]


@pytest.mark.parametrize("dim", [1, 4])
def test_cones_of_other_dimensions_are_refused(dim):
    with pytest.raises(kp.ShapeError, match=f"dimension {dim}"):
        kp.plot_cone(kp.orthant(dim))


def test_axes_and_cone_must_fit():
    _, ax = plt.subplots()
    with pytest.raises(kp.ShapeError, match="3d"):
        kp.plot_cone(kp.orthant(3), ax)


def test_improper_cones_are_refused():
    with pytest.raises(kp.NotProperConeError, match="X"):
        kp.plot_cone(kp.PolyhedralCone([[1, 0, 0], [0, 1, 0]]))


def test_choosing_the_backend_in_a_picture_leaves_interactive_mode_on(monkeypatch, node):
    """In a notebook the first figure chooses the backend, and that turns interactive mode on."""
    monkeypatch.setattr(plt, "draw_if_interactive", plt.ion)
    plt.ioff()
    try:
        for draw in (lambda: kp.plot_cone(kp.orthant(2)), lambda: kp.phase_portrait(node)):
            draw()
            assert plt.isinteractive()
    finally:
        plt.ioff()


def pictures():
    """One picture of each kind, and what python-control draws into the axes of others."""
    node = kp.examples.mass_spring_node()
    net = kp.feedback_interconnect([node] * 4, kp.examples.ring(4))
    plain, two = ct.ss([[-1]], [[1]], [[1]], 0), ct.ss([[-1, 0], [0, -2]], [[1], [1]], np.eye(2), 0)
    ours = {
        "cone": lambda: kp.plot_cone(kp.orthant(2)),
        "named": lambda: kp.plot_cone(kp.orthant(2), label="orthant"),
        "phase": lambda: kp.phase_portrait(node),
        "network": lambda: kp.plot_network(net),
        "poles": lambda: kp.plot_poles(net),
    }
    theirs = {
        "step": lambda: ct.step_response(plain).plot(),
        "steps": lambda: ct.step_response(two).plot(),
        "bode": lambda: ct.bode_plot(plain),
        "nyquist": lambda: ct.nyquist_plot(plain),
        "poles": lambda: ct.pole_zero_plot(plain),
    }
    return ours, theirs


def test_python_control_draws_into_a_new_figure_after_a_cone_in_space():
    """Into axes of three dimensions python-control cannot draw, as the docstring says."""
    kp.plot_cone(kp.orthant(3))
    plt.figure()
    ct.nyquist_plot(ct.ss([[-1]], [[1]], [[1]], 0))
    plt.gcf().canvas.draw()


@pytest.mark.parametrize("second", pictures()[1])
@pytest.mark.parametrize("first", pictures()[0])
def test_python_control_draws_after_a_picture_of_ours_and_before_it(first, second):
    ours, theirs = (those[name] for those, name in zip(pictures(), (first, second), strict=True))
    for one, other in ((ours, theirs), (theirs, ours)):
        plt.close("all")
        one()
        other()
        for number in plt.get_fignums():
            plt.figure(number).canvas.draw()


def test_every_line_has_a_label_of_text():
    for picture in pictures()[0].values():
        plt.close("all")
        axes = picture().axes.ravel()
        assert all(isinstance(line.get_label(), str) for ax in axes for line in ax.get_lines())


def test_closed_loops_of_modes_and_of_least_cost():
    modes = [([[1, 1], [1, -3]], [[1], [0]]), ([[-3, 1], [1, 1]], [[0], [1]])]
    plant = kp.ConeStateSpace(*modes[0], np.eye(2), np.zeros((2, 1)))
    switched = kp.state_feedback(plant, vertices=modes, per_mode=True)
    titles = [ax.get_title() for ax in kp.plot_closed_loop(plant, switched).axes.ravel()]
    assert titles == ["without feedback", "mode 0, u = F_s x", "mode 1, u = F_s x"]
    still = kp.ConeStateSpace([[0.5, 0.2], [0.1, 0.5]], [[0.1], [0]], np.eye(2), 0, True)
    cheap = kp.optimal_feedback(still, [1, 1], [0.1], [[1, 0]])
    assert [ax.get_title() for ax in kp.plot_closed_loop(still, cheap).axes.ravel()][1] == "least cost"
    dear = kp.optimal_feedback(kp.ConeStateSpace([[2.0]], [[0.1]], [[1]], 0, True), [1], [0], [[1]])
    steps = kp.optimal_feedback(still, [1, 1], [0.1], [[1, 0]], horizon=3)
    assert "first gain" in kp.plot_closed_loop(still, steps).axes.ravel()[1].get_title()
    placed = kp.design_cone_and_feedback(still, poles=[0.5, 0.1])
    assert "with its cone" in kp.plot_closed_loop(still, placed).axes.ravel()[1].get_title()
    with pytest.raises(kp.DataError, match="REFUTED, without a gain"):
        kp.plot_closed_loop(still, dear)
    with pytest.raises(kp.DataError, match="not an observer"):
        kp.plot_closed_loop(still, kp.observer_gain(still))


def test_long_names_of_many_signals_fit_below_and_beside_pictures():
    net = kp.feedback_interconnect([kp.examples.mass_spring_node()] * 20, kp.examples.ring(20))
    lines = kp.plot_responses(net.step_response(4.0), [0], inputs=range(12), kind="lines")
    picture = lines.figure
    picture.canvas.draw()
    legend, whole = lines.legend.get_window_extent(), picture.bbox
    assert whole.x0 <= legend.x0 < legend.x1 <= whole.x1
    rows = kp.plot_responses(net.step_response(4.0), [0], kind="map")
    assert len(rows.axes[0, 0].get_yticks()) == 20
    with pytest.raises(kp.DataError, match="60 named rows"):
        kp.plot_responses(net.step_response(4.0), [0, 1, 2], kind="map")
