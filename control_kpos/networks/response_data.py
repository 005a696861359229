"""Responses of networks, which python-control plots as long as that is a picture for a person."""

from __future__ import annotations

from typing import Any

from control import ControlPlot, TimeResponseData

from ..errors import TooLargeError

# Axes that python-control may draw: it takes seconds for these, and hours for those of 200 inputs and outputs.
MOST_AXES = 64


class NetworkResponse(TimeResponseData):
    """A `control.TimeResponseData` whose `plot` refuses pictures of too many axes."""

    def plot(self, *args: Any, **kwargs: Any) -> ControlPlot:
        """Plot with python-control, one axes for each signal and input; see `control.time_response_plot`.

        Parameters
        ----------
        *args, **kwargs
            For `control.time_response_plot`.

        Returns
        -------
        control.ControlPlot

        Raises
        ------
        TooLargeError
            More than 64 axes: `control_kpos.plot_responses` draws all of them in one.
        """
        rows = 1 if kwargs.get("overlay_signals") else self.noutputs
        columns = 1 if kwargs.get("overlay_traces") else max(self.ntraces, 1)
        if rows * columns > MOST_AXES:
            signals = f"{self.noutputs} outputs" + f" from {self.ntraces} inputs" * (self.ntraces > 1)
            raise TooLargeError(
                f"python-control draws one axes for each of {signals}, {rows * columns} in all (limit {MOST_AXES}). "
                "kp.plot_responses(response) draws all of them in one: bands, a heat map, or the outputs that you name."
            )
        return super().plot(*args, **kwargs)
