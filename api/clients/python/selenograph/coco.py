"""Labels of frames as COCO annotations, for training detectors: https://cocodataset.org/#format-data.

A crater's segmentation is the polygon of its rim in the image, hidden or not; a rock's is the run lengths of its
pixels. COCO counts pixels from the corner of the top-left one: coordinates are half a pixel larger than elsewhere.
"""

from __future__ import annotations

import glob
import json
import os
import tarfile
import zipfile
from typing import IO, Any, Callable, Dict, Iterator, List, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from .answers import Frame
from .version import __version__

CRATER = 1
ROCK = 2
CATEGORIES = [{"id": CRATER, "name": "crater", "supercategory": "landform"},
              {"id": ROCK, "name": "rock", "supercategory": "landform"}]
IDS_PER_IMAGE = 65536  # masks are uint16, so that a frame's own numbers are below this
# Members of a crater or rock in the metadata that are other members of an annotation, or none.
IMAGE_MEMBERS = ("id", "mask_id", "rim_px", "rim_ellipse", "rim_visible", "center_px", "center_visible")
MIN_NAME_DIGITS = 6  # of a manifest's line number as a frame's name

Json = Dict[str, Any]
Polygon = List[Tuple[float, float]]


class Tally(NamedTuple):
    """What write_coco wrote."""

    images: int
    annotations: int
    left_out: int  # frames without labels, of several cameras, or not in the manifest


def coco_of(frame: Frame, file_name: str = "frame.npz", camera: str = "") -> Json:
    """Returns the COCO document of a frame with `"labels": true`: one image, with annotations whose ids are those in
    `crater_mask` and `rock_mask`.

    camera: name of one of several cameras
    """
    meta = frame.meta["cameras"][camera] if camera else frame.meta
    image, annotations = coco_image(meta, frame[f"{camera}/rock_mask" if camera else "rock_mask"], 1, file_name)
    info = {"description": "Craters and rocks of a selenograph frame", "version": meta["software"]["version"],
            "detail": meta["detail"], "request": meta["request"]}
    return {"info": info, "licenses": [], "images": [image], "categories": CATEGORIES, "annotations": annotations}


def coco_image(meta: Mapping[str, Any], rock_mask: np.ndarray, image_id: int,
               file_name: str) -> Tuple[Json, List[Json]]:
    """Returns a frame's image and annotations, with ids from 1 as in the masks.

    meta: the frame's metadata, or those of one camera
    """
    height, width = rock_mask.shape
    image = {"id": image_id, "width": width, "height": height, "file_name": file_name}
    annotations = [{"id": crater["mask_id"], "image_id": image_id, **_crater(crater, width, height)}
                   for crater in meta["craters"] if crater["mask_id"] > 0]
    runs = _runs(rock_mask)
    annotations += [{"id": rock["mask_id"], "image_id": image_id, **_rock(rock, runs[rock["mask_id"]], width, height)}
                    for rock in meta["labelled_rocks"]]
    return image, annotations


def write_coco(folder: str, path: str, manifest: Optional[str] = None) -> Tally:
    """Writes the labels of a campaign's frames, NAME.npz or in tars, as one COCO document.

    An image's id is its line number in the manifest; without one, images are counted from 1, files by name before the
    contents of tars. An annotation's id is 65536 times that plus its `mask_id`, its number in the frame's masks. With
    one manifest, the lists of images and annotations of several folders can be concatenated.
    """
    numbers = _line_numbers(manifest) if manifest is not None else None
    info = {"description": "Craters and rocks of selenograph frames", "version": __version__}
    images: List[Json] = []
    left_out = 0
    annotation_count = 0
    partial_path = f"{path}.{os.getpid()}.part"
    try:
        with open(partial_path, "w", encoding="utf-8") as file:
            # Write annotations as they come: those of a campaign need not fit into memory.
            file.write(f'{{"info": {json.dumps(info)}, "licenses": [], "categories": {json.dumps(CATEGORIES)}, '
                       '"annotations": [')
            for name, tar, content in _frames_of(folder):
                number = len(images) + 1 if numbers is None else numbers.get(name)
                meta, rock_mask = _read_labels(name, content)
                if number is None or rock_mask is None:
                    left_out += 1
                    continue
                image, annotations = coco_image(meta, rock_mask, number, f"{name}.npz")
                images.append({**image, "tar": tar} if tar else image)
                for annotation in annotations:
                    annotation["mask_id"] = annotation["id"]
                    annotation["id"] += IDS_PER_IMAGE * number
                    file.write((",\n" if annotation_count else "\n") + json.dumps(annotation))
                    annotation_count += 1
            file.write(f'],\n"images": {json.dumps(images)}}}\n')
        os.replace(partial_path, path)
    finally:
        if os.path.exists(partial_path):
            os.unlink(partial_path)
    return Tally(len(images), annotation_count, left_out)


def _frames_of(folder: str) -> Iterator[Tuple[str, Optional[str], IO[bytes]]]:
    """Yields each frame's name, the tar that holds it, and its open .npz."""
    for path in sorted(glob.glob(os.path.join(glob.escape(folder), "*.npz"))):
        with open(path, "rb") as file:
            yield os.path.basename(path)[:-len(".npz")], None, file
    for path in sorted(glob.glob(os.path.join(glob.escape(folder), "*.tar"))):
        with tarfile.open(path) as tar:
            for member in tar:
                content = tar.extractfile(member)
                if content is not None and member.name.endswith(".npz"):
                    yield member.name[:-len(".npz")], os.path.basename(path), content


def _read_labels(name: str, content: IO[bytes]) -> Tuple[Json, Optional[np.ndarray]]:
    """Returns a frame's metadata and `rock_mask`; None without labels."""
    try:
        with np.load(content) as archive:
            return json.loads(archive["meta.json"]), archive["rock_mask"] if "rock_mask" in archive else None
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{name}.npz is damaged: remove it and run the campaign again: {error}") from error


def _line_numbers(manifest: str) -> Dict[str, int]:
    """Returns the line number, from 1, of each frame's name, as `selenograph batch` names frames."""
    with open(manifest, encoding="utf-8", errors="replace") as file:
        lines = {number: line for number, line in enumerate(file, 1) if line.strip()}
    digits = max(MIN_NAME_DIGITS, len(str(max(lines, default=0))))
    numbers: Dict[str, int] = {}
    for number, line in lines.items():
        try:
            request = json.loads(line)
        except ValueError:
            continue  # a line that is no request has no frame
        name = request.get("name", f"{number:0{digits}d}") if isinstance(request, dict) else None
        if isinstance(name, str):
            numbers.setdefault(name, number)
    return numbers


def _crater(crater: Mapping[str, Any], width: int, height: int) -> Json:
    """Returns an annotation of a crater in the metadata, without ids."""
    polygon = _clipped_to_image([(x + 0.5, y + 0.5) for x, y in crater["rim_px"]], width, height)
    columns, rows = zip(*polygon)
    left = min(columns)
    top = min(rows)
    twice_area = sum(ax * by - bx * ay for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1]))
    center = crater["center_px"]
    properties = {name: value for name, value in crater.items() if name not in IMAGE_MEMBERS}
    return {"category_id": CRATER,
            "bbox": [left, top, round(max(columns) - left, 3), round(max(rows) - top, 3)],
            "segmentation": [[coordinate for corner in polygon for coordinate in corner]],
            "area": round(abs(twice_area) / 2, 3),
            "iscrowd": 0,
            "crater_id": crater["id"],
            **properties,
            "rim_visible": crater["rim_visible"],
            "center": center and [round(coordinate + 0.5, 3) for coordinate in center],
            "center_visible": crater["center_visible"]}


def _clipped_to_image(polygon: Polygon, width: int, height: int) -> Polygon:
    """Returns the part of a polygon within the image, rounded to 0.001 pixels."""
    borders: List[Callable[[float, float], float]] = [
        lambda x, y: x, lambda x, y: y, lambda x, y: width - x, lambda x, y: height - y]
    for distance in borders:
        polygon = _clipped(polygon, distance)
    return [(round(x, 3), round(y, 3)) for x, y in polygon]


def _clipped(polygon: Polygon, distance: Callable[[float, float], float]) -> Polygon:
    """Returns the part of a polygon where a distance is not negative (Sutherland & Hodgman 1974)."""
    inside: Polygon = []
    for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1]):
        a = distance(ax, ay)
        b = distance(bx, by)
        if a >= 0:
            inside.append((ax, ay))
        if (a >= 0) != (b >= 0):
            # The edge crosses the border at this fraction of its length.
            crossing = a / (a - b)
            inside.append((ax + crossing * (bx - ax), ay + crossing * (by - ay)))
    return inside


def _runs(mask: np.ndarray) -> Dict[int, np.ndarray]:
    """Returns the runs of each number in a mask as n x 2 integers: the first index, and the index after the last.

    Indices count down the columns, as in COCO's run lengths.
    """
    flat = mask.T.ravel()
    changes = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    runs = np.stack([np.append(0, changes), np.append(changes, flat.size)], axis=1)
    numbers = flat[runs[:, 0]]
    order = np.argsort(numbers, kind="stable")
    found, first = np.unique(numbers[order], return_index=True)
    return dict(zip(found.tolist(), np.split(runs[order], first[1:])))


def _rock(rock: Mapping[str, Any], runs: np.ndarray, width: int, height: int) -> Json:
    """Returns an annotation of a rock in the metadata, without ids. runs: of its pixels in the mask."""
    first = runs[:, 0]
    last = runs[:, 1] - 1
    # A run that continues at the top of the next column touches both borders.
    has_borders = (first // height != last // height).any()
    left = int(first[0] // height)
    top = 0 if has_borders else int((first % height).min())
    box_width = int(last[-1] // height) - left + 1
    box_height = height if has_borders else int((last % height).max()) - top + 1
    counts = np.diff(runs.ravel(), prepend=0, append=width * height)  # outside and inside in turn
    return {"category_id": ROCK,
            "bbox": [left, top, box_width, box_height],
            "segmentation": {"size": [height, width], "counts": (counts if counts[-1] else counts[:-1]).tolist()},
            "area": int(counts[1::2].sum()),
            "iscrowd": 0,
            "rock_id": rock["id"],
            **{name: value for name, value in rock.items() if name not in IMAGE_MEMBERS}}
