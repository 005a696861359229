"""Integer polynomials: characteristic polynomials, common divisors, changes of the variable.

Polynomials are lists of Python integers, highest power first, known up to a positive factor.  Where FLINT computes,
our own integers check:

    characteristic polynomial p of M:   p is monic of degree n and p(M) x = 0 for a vector x for which x, M x, ..,
                                        M^(n-1) x are independent modulo a prime.  Then no other monic polynomial of
                                        degree n annihilates x, and the characteristic polynomial does (Cayley and
                                        Hamilton).  Where no such x exists, the traces of the powers of M decide.
    greatest common divisor g of a, b:  g divides both, and the quotients have no common divisor modulo a prime that
                                        divides neither leading coefficient.

Roots are isolated in `roots`.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from math import gcd, isqrt

import numpy as np
from flint import fmpz_mat, fmpz_poly
from numpy.typing import NDArray

from .budget import spend
from .linalg import LARGEST_PRIME, Rationals, WrongAnswerError, identity, independent_modulo, prime_below, product
from .matrix import Integers, Matrix

Polynomial = list[int]

# Operations for n^4 of a characteristic polynomial of doubles, and for a product of long integers.
_CHARACTERISTIC, _PRODUCT = 40.0, 150.0
# Primes tried before a common divisor counts as wrong; each fails for few polynomials.
_PRIMES = 8


# -- characteristic polynomials


def characteristic_polynomial(A: Matrix) -> tuple[Polynomial, Fraction]:
    """Characteristic polynomial of M, where A = M * f.

    Returns
    -------
    polynomial : list of int
        Monic, of M; the eigenvalues of A are its roots times f.
    f : Fraction
        Positive.

    Notes
    -----
    0.2 s for 60 rows of doubles, 2 s for 120; ten times that if some eigenvalue has several eigenvectors.
    """
    M, factor = A.as_integers()
    return characteristic_of(M), Fraction(factor)


def characteristic_of(M: Integers) -> Polynomial:
    """Characteristic polynomial of a matrix of integers."""
    n = M.shape[0]
    spend(_CHARACTERISTIC * n**4)
    if not n:
        return [1]
    p = [int(c) for c in reversed(fmpz_mat(n, n, M.ravel().tolist()).charpoly().coeffs())]
    annihilates = _annihilates(p, M)
    if annihilates is None:
        return _by_traces(M)
    if not annihilates:
        raise WrongAnswerError("characteristic polynomial")
    return p


def _annihilates(p: Polynomial, M: Integers) -> bool | None:
    """Whether p is the characteristic polynomial of M; None if a vector and its images do not span the space."""
    n = len(M)
    x = np.random.default_rng(0).integers(1, 100, n).astype(object)
    images = [x]
    for _ in range(n):
        images.append(M @ images[-1])
    if len(independent_modulo(np.array(images[:-1]), LARGEST_PRIME)[0]) < n:
        return None
    if len(p) != n + 1 or p[0] != 1:
        return False
    return not (np.array(p[::-1], dtype=object) @ np.array(images)).any()


def _by_traces(M: Integers) -> Polynomial:
    """Characteristic polynomial by Newton's identities, k c_k = -(c_(k-1) tr M + .. + c_0 tr M^k).

    The trace of M^(i + m j) is the sum of the products of the entries of M^i and of the transposed M^(m j), so that
    2 sqrt(n) powers suffice (Preparata and Sarwate, 1978).
    """
    n = len(M)
    steps = isqrt(n) + 1
    small = [np.eye(n, dtype=int).astype(object)]
    for _ in range(steps):
        small.append(small[-1] @ M)
    traces: list[int] = []
    far = small[0]
    while len(traces) <= n:
        spend(_PRODUCT * n**3)
        traces += [int((power * far.T).sum()) for power in small[:-1]]
        far = far @ small[-1]
    c: Polynomial = [1]
    for k in range(1, n + 1):
        c.append(-sum(c[k - i] * traces[i] for i in range(1, k + 1)) // k)
    return c


# -- changes of the variable


def scale_roots(p: Polynomial, factor: Fraction) -> Polynomial:
    """Polynomial whose roots are those of p times a positive factor."""
    n = len(p) - 1
    num, den = factor.numerator, factor.denominator
    return primitive_part([c * num**k * den ** (n - k) for k, c in enumerate(p)])


def shift_roots(p: Polynomial, by: Fraction) -> Polynomial:
    """Polynomial whose roots are those of p minus `by`."""
    num, den = by.numerator, by.denominator
    # With s = x / den, den^n p(x / den) has integer coefficients; Horner shifts it by num.
    out = [c * den**k for k, c in enumerate(p)]
    n = len(out) - 1
    spend(_PRODUCT * n**2)
    for i in range(n):
        for j in range(1, n + 1 - i):
            out[j] += num * out[j - 1]
    return primitive_part([c * den ** (n - k) for k, c in enumerate(out)])


def at_matrix(p: Polynomial, M: Rationals) -> Rationals:
    """p(M), by Horner's rule."""
    out = 0 * M
    for c in p:
        spend(_PRODUCT * len(M) ** 3)
        out = product(out, M) + c * identity(len(M))
    return out


def poles(p: Polynomial, M: Integers, x: Integers, u: Integers) -> Polynomial:
    """Denominator of u'(s I - M)^-1 x, where p is the characteristic polynomial of M.

    Its roots are eigenvalues of M with eigenvectors in every invariant subspace that holds x.
    """
    responses = []
    for _ in range(len(M)):
        responses.append(int(u @ x))
        x = M @ x
    over = [sum(a * h for a, h in zip(p[: k + 1], responses[k::-1], strict=True)) for k in range(len(M))]
    return _quotient(p, common_divisor(p, over))


def vanishes(p: Polynomial, at: Fraction) -> bool:
    """True if `at` is a root."""
    return _evaluate(p, at) == 0


def moebius(p: Polynomial, radius: Fraction) -> Polynomial:
    """Polynomial in s with p's roots z = radius (1 + s) / (1 - s): |z| > radius is Re s > 0.

    Roots at z = -radius go to infinity: the degree drops.
    """
    q = scale_roots(p, 1 / radius) if radius else p
    # z = 2 / (1 - s) - 1: roots one further, their reciprocals, twice those, and 1 minus them
    q = shift_roots(q, Fraction(-1))[::-1]
    q = shift_roots(scale_roots(q, Fraction(2)), Fraction(1))
    return _strip(mirrored(q))


def mirrored(p: Polynomial) -> Polynomial:
    """p(-s)."""
    return [c * (-1) ** k for k, c in enumerate(reversed(p))][::-1]


def without_roots_of_unity(p: Polynomial) -> tuple[Polynomial, list[int]]:
    """p without those roots that are roots of unity, and the orders removed."""
    orders = []
    p = primitive_part(p)
    for k in range(1, 2 * (len(p) - 1) ** 2 + 7):  # Euler's phi of k is at least sqrt(k / 2)
        if totient(k) > len(p) - 1:
            continue
        while (quotient := divided(p, cyclotomic(k))) is not None:
            p = quotient
            if k not in orders:
                orders.append(k)
    return p, orders


@cache
def totient(k: int) -> int:
    """Euler's phi: how many numbers up to k have no divisor in common with k."""
    count, rest, divisor = k, k, 2
    while divisor * divisor <= rest:
        if rest % divisor == 0:
            count -= count // divisor
            while rest % divisor == 0:
                rest //= divisor
        divisor += 1
    return count - count // rest if rest > 1 else count


@cache
def cyclotomic(k: int) -> Polynomial:
    """The polynomial whose roots are the roots of unity of order k."""
    out: Polynomial | None = [1] + [0] * (k - 1) + [-1]
    for divisor in range(1, k):
        if k % divisor == 0 and out is not None:
            out = divided(out, cyclotomic(divisor))
    if out is None:  # x^k - 1 is the product of those of all its divisors
        raise ArithmeticError(f"x^{k} - 1 has no such divisor")
    return out


def circle_part(p: Polynomial) -> Polynomial:
    """Greatest common divisor of p and its reversal: holds every root on the unit circle."""
    p = without_zero(p)
    return common_divisor(p, p[::-1])


def rational_roots(p: Polynomial, near: NDArray[np.complex128]) -> list[Fraction]:
    """Rational roots with small denominators next to some numbers, with multiplicity.

    Multiple roots are known to few digits only: the simplest fractions come first.
    """
    found: list[Fraction] = []
    p = primitive_part(p)
    for digits in (1, 10, 1000, 10**6):
        for root in sorted({Fraction(float(z.real)).limit_denominator(digits) for z in np.asarray(near)}):
            while len(p) > 1 and vanishes(p, root):
                found.append(root)
                p = _quotient(p, [root.denominator, -root.numerator])
    return found


def square_free_factors(p: Polynomial) -> list[Polynomial]:
    """p_1, p_2, .. without repeated or common roots, p = p_1 p_2^2 p_3^3 .. up to a factor (Yun)."""
    out = []
    common = common_divisor(p, derivative(p))
    rest = _quotient(p, common)
    while len(rest) > 1:
        shared = common_divisor(rest, common)
        out.append(_quotient(rest, shared))
        common = _quotient(common, shared)
        rest = shared
    return out


def square_free_part(p: Polynomial) -> Polynomial:
    """A polynomial with the same roots, each once."""
    return _quotient(p, common_divisor(p, derivative(p)))


# -- arithmetic


def common_divisor(a: Polynomial, b: Polynomial) -> Polynomial:
    """Greatest common divisor, primitive and with a positive leading coefficient; one of the two is not zero."""
    a, b = primitive_part(a), primitive_part(b)
    if not any(a) or not any(b):
        return _positive(a if any(a) else b)
    if _coprime(a, b):
        return [1]
    g = _positive([int(c) for c in reversed(_flint(a).gcd(_flint(b)).coeffs())] or [1])
    left, right = divided(a, g), divided(b, g)
    if left is None or right is None or not _coprime(left, right):
        raise WrongAnswerError("common divisor")
    return g


def _coprime(a: Polynomial, b: Polynomial) -> bool:
    """True if a and b have no common root; False if they seem to have one, modulo several primes."""
    prime = LARGEST_PRIME
    for _ in range(_PRIMES):
        if a[0] % prime and b[0] % prime and _degree_of_common(a, b, prime) == 0:
            return True
        prime = prime_below(prime)
    return False


def _degree_of_common(a: Polynomial, b: Polynomial, prime: int) -> int:
    """Degree of the greatest common divisor modulo a prime: at least that of the greatest common divisor."""
    u, v = np.array([c % prime for c in a], dtype=np.int64), np.array([c % prime for c in b], dtype=np.int64)
    while v.any():
        v = v[int(np.argmax(v != 0)) :]
        inverse = pow(int(v[0]), -1, prime)
        rest = u.copy()
        for k in range(len(rest) - len(v) + 1):
            if rest[k]:
                factor = int(rest[k]) * inverse % prime
                rest[k : k + len(v)] = (rest[k : k + len(v)] - factor * v) % prime
        u, v = v, rest[max(len(rest) - len(v) + 1, 0) :] if len(rest) >= len(v) else rest
    return len(u) - 1


def divided(a: Polynomial, b: Polynomial) -> Polynomial | None:
    """a / b for a primitive b, or None if b does not divide a; the division is exact (Gauss)."""
    rest, out = list(a), []
    for k in range(len(a) - len(b) + 1):
        lead, left = divmod(rest[k], b[0])
        if left:
            return None
        out.append(lead)
        if lead:
            for i, c in enumerate(b):
                rest[k + i] -= lead * c
    return out if out and not any(rest) else None


def _quotient(a: Polynomial, b: Polynomial) -> Polynomial:
    """a / b for a divisor b."""
    out = divided(primitive_part(a), primitive_part(b))
    if out is None:
        raise ArithmeticError("a polynomial is not divided by its divisor; please report this.")
    return out


def multiply(a: Polynomial, b: Polynomial) -> Polynomial:
    """The product."""
    out = [0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            out[i + j] += x * y
    return out


def derivative(p: Polynomial) -> Polynomial:
    """The derivative up to a positive factor."""
    n = len(p) - 1
    return primitive_part([c * (n - k) for k, c in enumerate(p[:-1])]) if n else [0]


def without_zero(p: Polynomial) -> Polynomial:
    """p without its roots at 0."""
    while len(p) > 1 and p[-1] == 0:
        p = p[:-1]
    return p


def primitive_part(p: Polynomial) -> Polynomial:
    """p without leading zeros, divided by the greatest common divisor of its coefficients."""
    p = _strip(p)
    g = gcd(*p)
    return [c // g for c in p] if g > 1 else p


def _strip(p: Polynomial) -> Polynomial:
    k = next((i for i, c in enumerate(p) if c), len(p) - 1)
    return p[k:]


def _positive(p: Polynomial) -> Polynomial:
    p = primitive_part(p)
    return p if p[0] >= 0 else [-c for c in p]


def _evaluate(p: Polynomial, at: Fraction) -> int:
    """p(at) times a positive integer."""
    num, den, value, power = at.numerator, at.denominator, 0, 1
    for c in p:
        value = value * num + c * power
        power *= den
    return value


def _flint(p: Polynomial) -> fmpz_poly:
    return fmpz_poly(p[::-1])
