"""What MTB4 and MTB3 do differently.

Sources: robotology/icub-firmware, embot_app_application_theSkin.cpp, embot_prot_can*.cpp (MTB4); mtb3/main_V3.c,
can_interface.c, options.h (MTB3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from .digitiser import GAINS_TYPE_0, GAINS_TYPE_8, Gains

GenerationName = Literal["mtb3", "mtb4"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Generation:
    """One generation of boards, as far as a host can tell it from another."""

    board_type: int  # in the answers to discovery and version
    application: tuple[int, int, int]
    protocol: tuple[int, int]
    any_minor: bool  # the version's OK needs its own major and at most its minor; else exactly both
    gains: Mapping[int, Gains]  # of the temperature compensation, by skin type; a type not in it has none
    narrow: bool  # 16-bit arithmetic that wraps, and a compensation rounded towards zero instead of down
    class_2_for_all: bool  # obeys skin commands sent to everyone
    code_mask: int  # of the command byte
    calibrates_in_ticks: int  # of its stream that it spends on a new baseline; 0: the tick's reading is it
    raw_test_mode: bool  # knows skin type 7
    legacy_stream: bool  # class 3 until the first new-style command
    stacks: bool  # the transmit queue is a stack
    thermometer: bool  # an SI7051


MTB4 = Generation(
    board_type=11,
    application=(1, 25, 0),
    protocol=(2, 0),
    any_minor=True,
    gains={0: GAINS_TYPE_0, 8: GAINS_TYPE_8},
    narrow=False,
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
    narrow=True,
    class_2_for_all=False,
    code_mask=0xFF,
    calibrates_in_ticks=3,  # one to begin, then two periods that it waits for the converters
    raw_test_mode=False,
    legacy_stream=True,
    stacks=True,
    thermometer=False,
)

GENERATIONS: Mapping[GenerationName, Generation] = {"mtb3": MTB3, "mtb4": MTB4}
