"""Settings of hints."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class HintSettings:
    """Off unless asked for, here or on the page; they take what time stitching leaves."""

    enabled: bool = False
    per_minute: float = 20.0  # of flight, of each kind: about what a person can look at
    model: str | None = None  # ONNX file of a detector; needs `pip install gcs-mosaic[detector]`
    detector: str | None = None  # an installed extension's, by its name, in the place of a model
    confidence: float = 0.3  # least confidence of what the detector finds
    megapixels: float = 4.0  # frames are reduced to at most so many before anything is sought in them

    def __post_init__(self) -> None:
        if self.model is not None and self.detector is not None:
            raise ValueError("detector: expected a model or a detector, got both")
        if not 0 < self.per_minute <= 1000:
            raise ValueError(f"per_minute: expected 0 to 1000, got {self.per_minute:g}")
        if not 0 < self.confidence <= 1:
            raise ValueError(f"confidence: expected 0 to 1, got {self.confidence:g}")
        if self.megapixels <= 0:
            raise ValueError(f"megapixels: expected more than 0, got {self.megapixels:g}")
