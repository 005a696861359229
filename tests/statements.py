"""What the package states, on random data, against an independent truth; tests run few, the campaign many."""

import warnings

import numpy as np

import control_kpos as kp
from control_kpos.errors import ActuatorLossWarning, KposError

# -- no foreign exception and no warning, in units up to the ends of floating point


def any_units(rng, size):
    bits = int(rng.choice([0, 0, 1, 30, 300, 500, 900, 1000]))
    return 2.0 ** rng.integers(-bits, bits + 1, size) if bits else np.ones(size)


@np.errstate(all="ignore")
def system_in_any_units(rng):
    """Often positive, often stable, with entries from 2**-1000 to 2**1000."""
    n, m, q = rng.integers(1, [5, 3, 3])
    A = rng.integers(-3, 4, (n, n)) * 1.0
    if rng.random() < 0.7:
        A = np.abs(A)
        np.fill_diagonal(A, -A.sum(axis=1) - rng.integers(0, 2, n))
    units = any_units(rng, n)
    matrices = [A * units[:, None] / units * any_units(rng, 1)]
    matrices += [rng.integers(0, 3, shape) * any_units(rng, 1) for shape in ((n, m), (q, n))]
    matrices.append(rng.integers(0, 2, (q, m)) * any_units(rng, 1) * (rng.random() < 0.3))
    matrices = [np.nan_to_num(M, nan=0.0, posinf=1e300, neginf=-1e300) for M in matrices]
    return kp.ConeStateSpace(*matrices, True if rng.random() < 0.3 else 0)


def _ask(rng, s, path):
    """One question about a system, and everything that can be done with the answer."""
    loops = [s] * int(rng.integers(1, 4))
    W = rng.integers(0, 3, (len(loops) * s.ninputs, len(loops) * s.noutputs)) * any_units(rng, 1) * 0.2
    rate = (None, "max", 0.5)[int(rng.integers(3))]
    questions = [
        s.cone_positivity,
        lambda: s.linear_lyapunov(rate),
        s.dissipativity,
        s.gain,
        lambda: kp.feedback_interconnect(loops, W).certificate,
        lambda: kp.feedback_interconnect(loops, W).abscissa_certificate(),
        lambda: kp.feedback_interconnect(loops, W).with_links(0.5 * W).certificate,
        lambda: (
            kp.feedback_interconnect(loops, W)
            .with_node(s, incoming={0: 0.5 * W[: s.ninputs, : s.noutputs]})
            .certificate
        ),
        lambda: kp.find_cone(s.A, discrete=bool(s.dt)),
        lambda: kp.find_cone(s, time_limit=1),
        lambda: kp.state_feedback(s, time_limit=1),
        lambda: kp.output_feedback(s, time_limit=1),
        lambda: kp.network_feedback(loops, 0 * W, time_limit=1),
        lambda: kp.scale_free_certificate(s, 0.5),
    ]
    answer = questions[int(rng.integers(len(questions)))]()
    for text in ("explain", "_repr_html_", "__repr__", "__str__", "check"):
        getattr(answer, text, str)()
    if isinstance(answer, kp.Certificate):
        answer.save(path)
        kp.load_certificate(path)


def foreign_errors(count, seed, mode, path):
    """Exceptions that are not ours, and warnings, with numpy told to `mode` every floating point error."""
    rng, found = np.random.default_rng(seed), []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", ActuatorLossWarning)
        for k in range(count):
            s = system_in_any_units(rng)
            try:
                with np.errstate(all=mode):
                    _ask(rng, s, path)
            except KposError:
                pass
            except Exception as error:  # noqa: BLE001 -- this is what is looked for
                found.append((seed, k, type(error).__name__, str(error)))
    return found
