"""The figure of converging runs: what is drawn is what the traces say."""

import numpy as np
import pytest

import redundancy as rd

matplotlib = pytest.importorskip("matplotlib")

from redundancy import plot  # noqa: E402


def test_convergence_draws_medians_and_shares() -> None:
    chain = rd.catalog.load("puma560").with_limits(lower=-np.inf, upper=np.inf)
    targets, starts = np.random.default_rng(1).uniform(-np.pi, np.pi, (2, 5, 6))
    names = ("coordinate_descent", "newton")
    traces = plot.convergence_traces(chain, chain.forward(targets), starts, names, iterations=40)
    assert list(traces) == list(names) and all(len(runs) == 5 for runs in traces.values())
    left, right = plot.convergence(traces).axes
    length = max(len(trace) for runs in traces.values() for trace in runs)
    for line, share, runs in zip(left.lines[:2], right.lines, traces.values(), strict=True):
        errors = np.array(
            [
                np.pad(
                    error := np.maximum(t.position_error, t.orientation_error),
                    (0, length - len(error)),
                    "edge",
                )
                for t in runs
            ]
        )
        np.testing.assert_allclose(line.get_ydata(), np.median(np.maximum(errors, 1e-12), axis=0))
        np.testing.assert_allclose(share.get_ydata(), 100 * (errors <= 1e-6).mean(axis=0))
    labels = [text.get_text() for text in left.get_legend().get_texts()]
    assert labels == ["coordinate descent", "newton"]
    with pytest.raises(ValueError, match="nothing to draw"):
        plot.convergence({"newton": []})
