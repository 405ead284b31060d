"""The differences between MTB4 and MTB3.

Sources: robotology/icub-firmware, embot_app_application_theSkin.cpp, embot_prot_can*.cpp (MTB4); mtb3/main_V3.c,
can_interface.c, options.h (MTB3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from ..physics.digitiser import GAINS_TYPE_0, GAINS_TYPE_8, Gains

GenerationName = Literal["mtb3", "mtb4"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Generation:
    """One generation of boards, as far as a host can distinguish it."""

    board_type: int  # in the answers to discovery and version
    application: tuple[int, int, int]
    protocol: tuple[int, int]
    any_minor: bool  # whether a version request is accepted with a lower minor number
    gains: Mapping[int, Gains]  # of the temperature compensation, by skin type; other types have none
    is_16_bit: bool  # whether arithmetic wraps at 16 bits, and the compensation rounds towards zero instead of down
    class_2_for_all: bool  # whether it obeys skin commands to all boards
    code_mask: int  # of the command byte
    calibrates_in_ticks: int  # ticks of its stream that a new baseline takes; 0: the next reading is the baseline
    raw_test_mode: bool  # whether it knows skin type 7
    legacy_stream: bool  # whether it streams in class 3 until the first command of the new style
    stacks: bool  # whether the transmit queue is a stack
    thermometer: bool  # whether it has an SI7051


MTB4 = Generation(
    board_type=11,
    application=(1, 25, 0),
    protocol=(2, 0),
    any_minor=True,
    gains={0: GAINS_TYPE_0, 8: GAINS_TYPE_8},
    is_16_bit=False,
    class_2_for_all=True,
    code_mask=0x7F,
    calibrates_in_ticks=0,
    raw_test_mode=True,
    legacy_stream=False,
    stacks=False,
    thermometer=True,
)

MTB3 = Generation(
    board_type=5,
    application=(2, 17, 0),
    protocol=(1, 0),
    any_minor=False,
    gains={0: GAINS_TYPE_0},
    is_16_bit=True,
    class_2_for_all=False,
    code_mask=0xFF,
    calibrates_in_ticks=3,  # one to begin, then two periods of waiting for the converters
    raw_test_mode=False,
    legacy_stream=True,
    stacks=True,
    thermometer=False,
)

GENERATIONS: Mapping[GenerationName, Generation] = {"mtb3": MTB3, "mtb4": MTB4}
