"""What networks, cone systems and certificates hand out: edits are refused or count; files give equal objects back."""

import certified
import control as ct
import numpy as np
import pytest
import scipy.sparse as sp
from network_examples import CONE, lag

import control_kpos as kp

EVERY = {**certified.CERTIFICATES, **certified.FOR_THE_PACKAGE}


def arrays_of(value, depth=4):
    """The arrays in an object, through records, tuples, dictionaries and sparse matrices."""
    if isinstance(value, np.ndarray):
        yield value
    elif sp.issparse(value):
        yield from (value.data, value.indices, value.indptr)
    elif isinstance(value, tuple | list):
        yield from (array for item in value for array in arrays_of(item, depth))
    elif isinstance(value, dict):
        yield from (array for item in value.values() for array in arrays_of(item, depth))
    elif depth and type(value).__module__.startswith("control_kpos") and hasattr(value, "__dict__"):
        public = {name: item for name, item in vars(value).items() if not name.startswith("_")}
        yield from arrays_of(public, depth - 1)


def networks():
    fractions = kp.ConeStateSpace([["-1/3"]], [[1]], [[1]], [["1/7"]])
    yield kp.feedback_interconnect([lag(1.0), fractions], [[0, "1/10"], [0.1, 0]])
    yield kp.feedback_interconnect([lag(1.0, D=0.1)] * 3, 0.2 * np.roll(np.eye(3), 1, 0), inputs=[0], outputs=[1, 2])
    yield kp.feedback_interconnect([lag(0.1)] * 2, [[-1, 1], [1, -1]])
    yield kp.feedback_interconnect([lag(1.0)] * 2, [[0, 2], [2, 0]])


@pytest.mark.parametrize("net", list(networks()))
def test_nothing_of_a_network_can_be_edited_in_vain(net):
    """Its arrays refuse edits; sparse matrices are handed out anew: an edit of one is not one of the network."""
    names = ("A", "B", "C", "D", "sparse_A", "sparse_B", "sparse_C", "sparse_D", "external", "certificate", "model")
    parts = [getattr(net, name) for name in names]
    model = net.model
    parts += [model.W, model.WT, model.offsets, model.block_matrices, net.certificate.node_margins, net.exact]
    parts += [net.X.rays, net.U.facets, net.Y.interior_point, net.certificate.residuals, net.certificate.witness]
    arrays = [array for part in parts for array in arrays_of(part)]
    assert len(arrays) > 30 and not any(array.flags.writeable for array in arrays if array.size)
    before = net.A
    net.sparse_A.data = np.zeros(net.sparse_A.nnz)
    assert np.array_equal(net.A, before) and net.sparse_A.nnz
    with pytest.raises(AttributeError):
        net.A = before


def test_what_a_network_was_made_of_can_change_without_it():
    node, W, A = lag(1.0), sp.csr_array([[0, 0.1], [0.1, 0]]), np.full((2, 1, 1), -1.0)
    nets = [kp.feedback_interconnect([node] * 2, W), kp.feedback_interconnect(kp.stack(A, [[1]], [[1]]), W)]
    before = [net.A for net in nets]
    node.A[0, 0], W.data[0], A[0] = 5, 99, 7
    for net, matrix in zip(nets, before, strict=True):
        assert np.array_equal(net.A, matrix) and net.certificate and net.certificate.check()


def test_edits_of_a_cone_system_count():
    s = kp.ConeStateSpace([["-1/3", 0], [0, -2]], [[1], [1]], [[1, 1]], 0)
    certificate = s.linear_lyapunov()
    s.A[0, 0] = 5
    assert not s.linear_lyapunov() and s.exact.A.values[0, 0] == 5 and certificate and certificate.check()
    s.A = np.array([[-1.0, 0], [1, -1]])
    assert s.linear_lyapunov()


@pytest.mark.parametrize("name", EVERY)
def test_a_file_gives_an_equal_certificate_back(name, tmp_path):
    certificate = EVERY[name]()
    for suffix in ("json", "npz"):
        certificate.save(tmp_path / f"file.{suffix}")
        again = kp.load_certificate(tmp_path / f"file.{suffix}")
        assert again == certificate and certificate == again and hash(again) == hash(certificate)
    assert certificate != EVERY["stable" if name != "stable" else "dissipative"]() and certificate != 1


def test_certificates_about_other_numbers_are_not_equal():
    one, other = (kp.linear_lyapunov([[rate]], kp.orthant(1)) for rate in (-1, -1 - 2.0**-50))
    assert one and other and one != other and one == kp.linear_lyapunov([["-1"]], kp.orthant(1))


def test_a_transfer_function_becomes_a_system():
    P = ct.tf([1], [1, 3, 2], name="P", inputs=["a"], outputs=["b"])
    s = kp.ConeStateSpace(P, X=CONE)
    assert isinstance(s, kp.ConeStateSpace) and s.name == "P" and s.input_labels == ["a"] and s.X == CONE
    assert np.allclose(s.dcgain(), 0.5) and kp.ConeStateSpace(ct.tf([1], [1, -0.5], 0.1)).dt == 0.1
    for wrong in (ct.tf([1, 0, 0], [1, 2]), ct.frd([1, 2], [1, 2])):
        with pytest.raises(kp.DataError, match=r"[tT]ransfer ?[fF]unction"):
            kp.ConeStateSpace(wrong)
    with pytest.raises(kp.DataError, match="A is a FrequencyResponseData; give a matrix"):
        kp.find_cone(ct.frd([1, 2], [1, 2]))
