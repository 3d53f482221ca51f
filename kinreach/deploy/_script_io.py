"""In- and outputs of the simulated controller, and its registers."""

from __future__ import annotations


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

    def __init__(self) -> None:
        self.digital = self.tool_voltage = 0
        self.analog, self.flags = [0.0, 0.0], [False] * 33
        self.floats, self.given_floats = dict[int, float](), dict[int, float]()
        self.booleans, self.given_booleans = dict[int, bool](), dict[int, bool]()
        self.given_integers = dict[int, int]()

    def set_digital(self, bit: int, *, is_on: bool) -> None:
        self.digital = self.digital | 1 << bit if is_on else self.digital & ~(1 << bit)
