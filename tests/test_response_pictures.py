"""Responses of all inputs at once, and pictures of many signals: what is drawn is what was simulated."""

import control as ct
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import LogNorm

import control_kpos as kp
from control_kpos.networks import simulate

T = np.linspace(0, 4, 40)


def masses(n, **more):
    return kp.feedback_interconnect([kp.examples.mass_spring_node()] * n, kp.examples.ring(n), **more)


NET, LARGE = masses(4), masses(60)
STEPS = NET.step_response(T)
DIRECT = kp.feedback_interconnect([kp.ConeStateSpace([[-2]], [[1]], [[1]], [["0.5"]])] * 3, 0.5 * kp.examples.ring(3))
DISCRETE = kp.feedback_interconnect([kp.ConeStateSpace([[0.5]], [[0.5]], [[1]], 0, 0.1)] * 3, 0.2 * kp.examples.ring(3))
FAST = kp.feedback_interconnect(
    [kp.ConeStateSpace([[-1e4, 1], [0, -1]], [[1e4], [1]], [[1, 1]], 0)] * 2, [[0, 0.1], [0, 0]]
)


@pytest.mark.parametrize("dense", [0, 1500])
@pytest.mark.parametrize("net", [NET, DIRECT, DISCRETE, FAST], ids=["masses", "feedthrough", "discrete", "fast"])
def test_steps_are_those_of_python_control(net, dense, monkeypatch):
    monkeypatch.setattr(simulate, "_MOST_DENSE", dense)
    monkeypatch.setattr(simulate, "_STIFF", 3e4)
    times = 0.1 * np.arange(20)
    ours, theirs = net.step_response(times), ct.step_response(ct.ss(net.A, net.B, net.C, net.D, net.dt), times)
    assert isinstance(ours, ct.TimeResponseData) and ours.inputs.shape == theirs.inputs.shape
    assert np.allclose(ours.outputs, theirs.outputs, atol=1e-6 if net is FAST else 1e-9)
    assert np.allclose(ours.states, theirs.states, atol=1e-6 if net is FAST else 1e-9)


def test_some_steps_of_some_inputs_from_some_state():
    part = NET.step_response(T, 0.1, inputs=[2, 0], outputs=[-1], states=False)
    free = NET.initial_response(T, 0.1, outputs=[-1]).outputs
    assert np.allclose(part.outputs[0], STEPS.outputs[3][[2, 0]] + free) and part.x is None
    assert [label.removeprefix("From ") for label in part.trace_labels] == [NET.input_labels[k] for k in (2, 0)]
    assert NET.step_response([0.0]).y.shape == (4, 4, 1)


def test_the_default_time_lets_the_slowest_pole_settle():
    assert NET.step_response().time[-1] == pytest.approx(7 / -NET.poles(1)[0].real)
    end = DISCRETE.step_response()
    assert np.allclose(end.outputs[..., -1], end.outputs[..., -2], rtol=1e-2)
    with pytest.raises(kp.DataError, match="T"):
        kp.feedback_interconnect([kp.ConeStateSpace([[1]], [[1]], [[1]], 0)], [[0]]).step_response()


def test_responses_that_are_refused():
    for wrong, error in (
        ({"inputs": [9]}, kp.ShapeError),
        ({"inputs": ["x"]}, kp.ShapeError),
        ({"T": -1}, kp.DataError),
    ):
        with pytest.raises(error):
            NET.step_response(**{"T": T, **wrong})
    with pytest.raises(kp.TooLargeError, match="outputs="):
        LARGE.step_response(np.linspace(0, 1, 10**5))


def test_python_controls_plot_ends_at_a_number_of_axes():
    assert STEPS.plot().axes.shape == (4, 4)
    wide = LARGE.step_response(T)
    with pytest.raises(kp.TooLargeError, match=r"kp\.plot_responses"):
        wide.plot()
    with pytest.raises(kp.TooLargeError, match="60 outputs from 60 inputs"):
        wide.plot(overlay_signals=False)
    plt.close("all")
    assert masses(12).step_response(T).plot(overlay_signals=True, overlay_traces=True, show_legend=False).axes.size == 1


@pytest.fixture(autouse=True)
def no_figures():
    yield
    plt.close("all")


def test_few_signals_are_lines_with_their_names():
    cplt = kp.plot_responses(STEPS, inputs=[1])
    bands, lines = cplt.lines
    assert not bands and len(lines) == 4
    for k, line in enumerate(lines):
        assert np.array_equal(line.get_ydata(), STEPS.outputs[k, 1]) and line.get_label() == NET.output_labels[k]
    assert NET.input_labels[1] in cplt.figure.get_suptitle()
    assert cplt.axes[0, 0].get_xlabel() == "Time [s]"


def test_many_signals_are_bands_between_their_extremes():
    wide = LARGE.step_response(T)
    bands, lines = kp.plot_responses(wide, outputs=[3], inputs=[3, 4]).lines
    y = wide.outputs[:, [3, 4]].reshape(120, -1)
    edges = bands[0].get_paths()[0].vertices[:, 1]
    assert edges.max() == y.max() and edges.min() == y.min()
    assert np.allclose(bands[-1].get_ydata(), np.median(y, axis=0)) and bands[-1].get_label() == "median"
    assert [line.get_label() for line in lines] == [
        f"{LARGE.output_labels[3]} from {LARGE.input_labels[k]}" for k in (3, 4)
    ]
    for line, k in zip(lines, (3, 4), strict=True):
        assert np.array_equal(line.get_ydata(), wide.outputs[3, k])
    one = kp.plot_responses(LARGE.initial_response(T, 1.0))
    assert len(one.lines[0]) and not len(one.lines[1])


def test_a_heat_map_has_a_row_for_every_signal():
    response = LARGE.forced_response(T, np.ones((60, 40)), states=False)
    drawn = kp.plot_responses(
        response, ["node[3]_position"] if "node[3]_position" in LARGE.output_labels else [3], kind="map"
    )
    image = drawn.lines[0][0]
    assert np.allclose(image.get_array(), response.outputs) and not drawn.lines[1]
    ax = drawn.axes[0, 0]
    assert ax.get_ylim()[0] > ax.get_ylim()[1] and [t.get_text() for t in ax.get_yticklabels()] == [
        LARGE.output_labels[3]
    ]
    spread = kp.plot_responses(LARGE.step_response(T, inputs=[0]), kind="map").lines[0][0]
    assert isinstance(spread.norm, LogNorm)
    signed = ct.step_response(ct.ss(np.diag([-1.0, -2]), np.eye(2), [[1, -1], [0, 1]], 0), T)
    norm = kp.plot_responses(signed, kind="map").lines[0][0].norm
    assert norm.vmin == -norm.vmax


def test_responses_of_python_control_and_axes_of_the_user():
    plain = ct.step_response(ct.ss([[-1]], [[1]], [[1]], 0), T)
    _, axes = plt.subplots(1, 2)
    cplt = kp.plot_responses(plain, ax=axes[1], title="mine")
    assert cplt.axes[0, 0] is axes[1] and axes[1].get_title() == "mine" and not axes[0].has_data()
    assert axes[1].get_ylabel() == plain.output_labels[0]


@pytest.mark.parametrize(
    ("wrong", "error", "words"),
    [
        ({"response": 3}, kp.DataError, "step_response"),
        ({"outputs": ["nobody"]}, kp.ShapeError, "nobody"),
        ({"outputs": [99]}, kp.ShapeError, "outputs"),
        ({"outputs": []}, kp.ShapeError, "outputs"),
        ({"inputs": [99]}, kp.ShapeError, "inputs"),
        ({"kind": "pie"}, kp.DataError, "kind"),
        ({"kind": "lines"}, kp.DataError, "16 lines"),
        ({"ax": 3}, kp.DataError, "ax"),
        ({"response": NET.initial_response(T, 1.0), "inputs": [0]}, kp.DataError, "single trace"),
    ],
)
def test_what_is_no_picture(wrong, error, words):
    with pytest.raises(error, match=words):
        kp.plot_responses(**{"response": STEPS, **wrong})
