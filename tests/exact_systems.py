"""Rows for methods of systems and networks: arguments that are no doubles, what is made of them, and what should be."""

from fractions import Fraction

from exact_plants import LAG, THIRD, THIRDS, plant

import control_kpos as kp

CONE, SAME = [["1/3", "1/7"], [0, 1]], kp.PolyhedralCone([[7, 3], [0, 1]])
SIDE, SIDES = [["1/3"]], [[THIRD]]
MINUS, TWO = [[-1, 0], [0, -1]], [[1, 0], [0, 1]]
LOOP = kp.feedback_interconnect([THIRDS], [[0]])
LATE = {"A": [["-1/3"]], "A_delay": [["1/7"]]}
DATA = {"X0": [[1, 0]], "X1": [["1/3", "1/7"]], "U0": [[0, 1]], "noise": "1/99"}


def of_data(**more):
    """Certificates of both functions about measurements."""
    return [ask(**DATA | more).certificate for ask in (kp.data_feedback, kp.data_positivity)]


MEASURED = {
    "X0": lambda: ([c.X0 for c in of_data(X0=[["1/3", 0]])], [[["1/3", 0]]] * 2),
    "X1": lambda: ([c.X1 for c in of_data()], [[[THIRD, "1/7"]]] * 2),
    "U0": lambda: ([c.U0 for c in of_data(U0=[[0, "1/3"]])], [[[0, THIRD]]] * 2),
    "noise": lambda: ([c.noise for c in of_data()], [[["1/99"] * 2]] * 2),
    "X": lambda: (
        kp.data_positivity([[1, 0], [0, 1]], [["1/2", 0], [0, "1/2"]], noise=0, X=CONE).certificate.X,
        SAME,
    ),
}
TANKS = {"flows": [[0, "1/3"], [0, 0]], "outflows": ["1/7", 0], "B": [["1/3"], [0]], "C": [[0, "1/3"]]}
ROWS = {
    "data_feedback": MEASURED,
    "data_positivity": MEASURED,
    "positive_realization": {
        "G": lambda: (kp.positive_realization([0, "1/3", "1/9", "1/27", "1/81"]).certificate.A, [[THIRD]]),
    },
    "compartmental": {
        "flows": lambda: (kp.compartmental(**TANKS).certificate.flows, [[0, THIRD], [0, 0]]),
        "outflows": lambda: (kp.compartmental(**TANKS).certificate.outflows, [[Fraction(1, 7), 0]]),
        "B": lambda: (kp.compartmental(**TANKS).B, [[THIRD], [0]]),
        "C": lambda: (kp.compartmental(**TANKS).C, [[0, THIRD]]),
    },
    "delayed": {
        "A": lambda: (kp.delayed(**LATE).A, [[-THIRD]]),
        "A_delay": lambda: (kp.delayed(**LATE).A_delay[0], [[Fraction(1, 7)]]),
        "X": lambda: (kp.delayed([[-1, 0], [0, -1]], [[0, 0], [0, 0]], CONE).X, SAME),
        "max_delay": lambda: (kp.delayed(**LATE, max_delay="1/3").max_delay, THIRD),
    },
    "interval_observer": {
        "sys": lambda: (kp.interval_observer(THIRDS).certificate.plant, [[-THIRD]]),
        "disturbance": lambda: (kp.interval_observer(LAG, disturbance=([0], ["1/3"])).certificate.exact[1], (THIRD,)),
        "noise": lambda: (kp.interval_observer(LAG, noise="1/3").certificate.exact[2], (THIRD,)),
        "X": lambda: (kp.interval_observer(plant(MINUS, TWO, TWO), X=CONE).cone, SAME),
    },
    "ConeStateSpace": {
        "args": lambda: (kp.ConeStateSpace([["-1/3"]], SIDE, SIDE, [["1/9"]]).exact.D, [["1/9"]]),
        "X": lambda: (plant(MINUS, X=CONE).exact.X, SAME),
        "U": lambda: (plant(MINUS, TWO, U=CONE).exact.U, SAME),
        "Y": lambda: (plant(MINUS, TWO, TWO, Y=CONE).exact.Y, SAME),
    },
    "ConeStateSpace.append": {"other": lambda: (LAG.append(THIRDS).exact.A, [[-1, 0], [0, -THIRD]])},
    "ConeStateSpace.feedback": {
        "other": lambda: (THIRDS.feedback(SIDE, sign=1).exact.A, [[0]]),
        "sign": lambda: (THIRDS.feedback(1, sign="1/3").exact.A, [[0]]),
    },
    "ConeStateSpace.lft": {"other": lambda: (THIRDS.lft(THIRDS).exact.A, [[-THIRD, 1], [1, -THIRD]])},
    "ConeStateSpace.linear_lyapunov": {"rate": lambda: (THIRDS.linear_lyapunov(rate="1/3").required_rate, THIRD)},
    "ConeStateSpace.dissipativity": {
        "q": lambda: (LAG.dissipativity(q=["-1/3"]).q_exact, [-THIRD]),
        "r": lambda: (LAG.dissipativity(r=["1/3"]).r_exact, [THIRD]),
    },
    "ConeStateSpace.similarity_transform": {
        "T": lambda: (THIRDS.similarity_transform(SIDE).exact.B, SIDES),
        "timescale": lambda: (THIRDS.similarity_transform([[1]], timescale="1/3").exact.A, [[-1]]),
    },
    "ConeNetwork.append": {"other": lambda: (LOOP.append(THIRDS).exact.A, [[-THIRD, 0], [0, -THIRD]])},
    "ConeNetwork.feedback": {
        "other": lambda: (LOOP.feedback(SIDE, sign=1).exact.A, [[0]]),
        "sign": lambda: (LOOP.feedback(1, sign="1/3").exact.A, [[0]]),
    },
    "ConeNetwork.lft": {"other": lambda: (LOOP.lft(THIRDS).exact.A, [[-THIRD, 1], [1, -THIRD]])},
    "ConeNetwork.linear_lyapunov": {"rate": lambda: (LOOP.linear_lyapunov(rate="1/3").required_rate, THIRD)},
    "ConeNetwork.dissipativity": {
        "q": lambda: (LOOP.dissipativity(q=["-1/3"]).q_exact, [-THIRD]),
        "r": lambda: (LOOP.dissipativity(r=["1/3"]).r_exact, [THIRD]),
    },
    "ConeNetwork.similarity_transform": {
        "T": lambda: (LOOP.similarity_transform(SIDE).exact.B, SIDES),
        "timescale": lambda: (LOOP.similarity_transform([[1]], timescale="1/3").exact.A, [[-1]]),
    },
}
