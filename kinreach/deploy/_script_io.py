"""In- and outputs of the simulated controller, and its registers."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class InputsOutputs:
    """What programs and clients write; inputs that nobody writes are off, or 0.

    Attributes:
        digital: Bits of the outputs: 0 to 7 standard, 8 to 15 configurable, 16 and 17 of the tool.
        analog: Both outputs, from 0 to 1.
        tool_voltage: 0, 12 or 24 [V].
        flags: That programs keep for others.
        floats, booleans: Output registers.
        given_integers, given_floats, given_booleans: Input registers, which clients write.
    """

    digital: int = 0
    analog: list[float] = field(default_factory=lambda: [0.0, 0.0])
    tool_voltage: int = 0
    flags: list[bool] = field(default_factory=lambda: [False] * 33)
    floats: dict[int, float] = field(default_factory=dict)
    booleans: dict[int, bool] = field(default_factory=dict)
    given_integers: dict[int, int] = field(default_factory=dict)
    given_floats: dict[int, float] = field(default_factory=dict)
    given_booleans: dict[int, bool] = field(default_factory=dict)

    def set_digital(self, bit: int, *, is_on: bool) -> None:
        self.digital = self.digital | 1 << bit if is_on else self.digital & ~(1 << bit)
