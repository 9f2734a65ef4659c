"""Frames of `selenograph batch` with labels, as a PyTorch Dataset."""

import glob
import io
import json
import os
import tarfile
from typing import Any, Dict, List, Tuple

import numpy as np
import torch


def largest_number(meta: Dict[str, Any]) -> int:
    """The largest digital number of a frame's image, of its metadata: 12 bits are stored in 16."""
    request = meta["request"]
    return 2 ** (request["sensor"]["detector"] if "sensor" in request else request["image"])["bit_depth"] - 1


class LabelledFrames(torch.utils.data.Dataset):
    """The frames of a folder: NAME.npz, or in tars (--format webdataset). Sorted by name; safe in worker processes.

    An item is a dict of
      name     of the frame
      image    float32, 1 x height x width, of the largest digital number of its bit depth
      masks    float32, 2 x height x width: 1 in a crater, on a rock
      depth_m  float32, 1 x height x width, with product "depth"; NaN where nothing is hit
    """

    def __init__(self, folder: str) -> None:
        # (name, file, offset in it, bytes)
        self._places: List[Tuple[str, str, int, int]] = []
        for path in glob.glob(os.path.join(glob.escape(folder), "*.npz")):
            self._places.append((os.path.basename(path)[:-4], path, 0, os.path.getsize(path)))
        for path in glob.glob(os.path.join(glob.escape(folder), "*.tar")):
            with tarfile.open(path) as tar:
                self._places += [(m.name[:-4], path, m.offset_data, m.size) for m in tar if m.name.endswith(".npz")]
        if not self._places:
            raise FileNotFoundError(f"{folder}: has no frames as NAME.npz or in tars")
        self._places.sort()

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, number: int) -> Dict[str, Any]:
        name, path, offset, size = self._places[number]
        with open(path, "rb") as file:
            file.seek(offset)
            archive = np.load(io.BytesIO(file.read(size)))
        if "crater_mask" not in archive:
            raise ValueError(f"{path}: {name} has no labels: \"labels\": true in its request makes them")
        image, largest = archive["image"], largest_number(json.loads(archive["meta.json"]))
        item = {"name": name,
                "image": torch.from_numpy(image[None] / np.float32(largest)),
                "masks": torch.from_numpy(np.stack([archive["crater_mask"] > 0, archive["rock_mask"] > 0])
                                          .astype(np.float32))}
        if "depth" in archive:
            item["depth_m"] = torch.from_numpy(archive["depth"][None].astype(np.float32))
        return item
