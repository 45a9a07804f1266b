"""ChArUco boards: chessboards with a marker in each white square, by which OpenCV distinguishes corners."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.errors import ErrorCode, InputError
from poise.types import Array

Detect = Callable[[NDArray[np.uint8]], tuple[Array, Array]]
"""From an image (H, W, 3) to corners (N, 2) m on a board and their pixels (N, 2)."""
_DOTS = 1200
"""Pixels along the longer side of a drawn board."""


@dataclass(frozen=True)
class Board:
    """A ChArUco board.

    Args:
        columns, rows: squares.
        square, marker: m, sides of a square and of a marker.
        dictionary: of OpenCV, without DICT_.

    Raises:
        InputError: BAD_INPUT.
    """

    columns: int = 8
    rows: int = 6
    square: float = 0.03
    marker: float = 0.022
    dictionary: str = "4X4_50"

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or not 0 < self.marker < self.square < 1:
            raise InputError(
                ErrorCode.BAD_INPUT,
                f"calibrate: a board of {self.columns} x {self.rows} squares of {self.square:g} m with markers of"
                f" {self.marker:g} m: give 3 x 3 squares or more, sides in m, and markers smaller than squares",
            )

    def detector(self) -> Detect:
        """Finds its corners in images.

        Raises:
            InputError: UNSUPPORTED without OpenCV, BAD_INPUT for a dictionary that it does not have.
        """
        cv2, board = self._board()
        finder = cv2.aruco.CharucoDetector(board)
        places = np.asarray(board.getChessboardCorners(), dtype=np.float64)[:, :2]

        def detect(image: NDArray[np.uint8]) -> tuple[Array, Array]:
            corners, numbers, _, _ = finder.detectBoard(cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY))
            if numbers is None:
                return np.zeros((0, 2)), np.zeros((0, 2))
            return places[numbers.ravel()], corners.reshape(-1, 2).astype(np.float64)

        return detect

    def picture(self) -> bytes:
        """PNG to print: one square is `square` wide when the width of the picture is columns x square."""
        cv2, board = self._board()
        dots = _DOTS // max(self.columns, self.rows)
        image = board.generateImage((dots * self.columns, dots * self.rows))
        return bytes(cv2.imencode(".png", image)[1].tobytes())

    def _board(self) -> tuple[Any, Any]:
        try:
            cv2: Any = importlib.import_module("cv2")
        except ImportError as error:
            raise InputError(
                ErrorCode.UNSUPPORTED, "calibrate: boards are found by OpenCV: pip install 'poise[vision]'"
            ) from error
        number = getattr(cv2.aruco, f"DICT_{self.dictionary}", None)
        if number is None:
            raise InputError(ErrorCode.BAD_INPUT, f"calibrate: OpenCV has no dictionary {self.dictionary}; try 4X4_50")
        size = (self.columns, self.rows)
        return cv2, cv2.aruco.CharucoBoard(size, self.square, self.marker, cv2.aruco.getPredefinedDictionary(number))
