"""A simulated device behind two calls, read and driven sample by sample in simulated time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from datasets_synthetic import Rig
from tests.exact_axis import Axis, advance, counted


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """What goes wrong, and from which sample on; by default nothing ever does."""

    nan_from: int = 10**9
    read_fails_from: int = 10**9
    write_fails_from: int = 10**9
    write_fails_times: int = 10**9
    stop_from: int = 10**9
    late_at: int = 10**9
    late: float = 0.0


class SteppedDevice:
    """One rigid device; its clock stands still but for ``wait_until``."""

    def __init__(self, rig: Rig, fault: Fault | None = None) -> None:
        self._rig, self._fault = rig, fault or Fault()
        self._axis = Axis(
            mass=rig.mass,
            damping=rig.damping,
            coulomb=rig.coulomb_friction,
            offset=rig.force_offset,
        )
        late = float(rig.delay[0] / rig.sample_time[0])
        self._whole, self._part = int(late + 1e-9), max(late - int(late + 1e-9), 0.0)
        self._place, self._speed, self._sent = np.zeros(1), np.zeros(1), [0.0]
        self._failed = 0
        self._due = 0
        #: Samples gone by, force written last, and every position that was read.
        self.sample, self.force = 0, 0.0
        self.readings: list[float] = []

    def read_position(self) -> float:
        """The encoder's reading, m (rad)."""
        if self._due >= self._fault.read_fails_from:
            raise OSError("the encoder is gone")
        if self._due >= self._fault.nan_from:
            return float("nan")
        (reading,) = counted(self._place, self._rig.encoder_resolution)
        self.readings.append(float(reading))
        return float(reading)

    def write_force(self, force: float) -> None:
        """The force from now on, N (N·m)."""
        fails = self._failed < self._fault.write_fails_times
        if self._due >= self._fault.write_fails_from and fails:
            self._failed += 1
            raise OSError("the amplifier is gone")
        self.force = force

    def stop_pressed(self) -> bool:
        """Whether the emergency stop is pressed."""
        return self._due >= self._fault.stop_from

    def wait_until(self, due: float) -> float:
        """Let the device move up to a time, s; returns the time it is."""
        step = float(self._rig.sample_time[0])
        self._due = round(due / step)
        late = self._fault.late if self._due == self._fault.late_at else 0.0
        for sample in range(self.sample, round((due + late) / step)):
            self._sent.append(self.force)
            for samples, share in ((self._whole + 1, self._part), (self._whole, 1 - self._part)):
                if share > 1e-9:
                    self._move(self._sent[max(sample + 1 - samples, 0)], share * step)
            self.sample = sample + 1
        return self.sample * step

    def _move(self, force: float, span: float) -> None:
        pull = np.full(1, force) - self._axis.offset
        travel, self._speed = advance(self._axis, self._speed, pull, np.full(1, span))
        self._place = self._place + travel
