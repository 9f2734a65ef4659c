"""A pinhole camera; pixel (0, 0) is the centre of the top-left one."""

import dataclasses

import cv2
import numpy as np


@dataclasses.dataclass(frozen=True)
class Camera:
    side: int
    focal: float  # pixels
    centre: float

    @classmethod
    def of(cls, side, fov_deg):
        return cls(side, 0.5 * side / np.tan(np.radians(0.5 * fov_deg)), 0.5 * (side - 1))

    @property
    def request(self):
        return {"model": "pinhole", "width": self.side, "height": self.side, "fx": self.focal, "fy": self.focal,
                "cx": self.centre, "cy": self.centre}

    def reduced(self, factor):
        """Returns the camera of a frame whose blocks of factor x factor pixels have been averaged."""
        return Camera(self.side // factor, self.focal / factor, (self.centre - 0.5 * (factor - 1)) / factor)

    def pixels(self, seen):
        """Returns the pixels of points in camera axes, (n, 3)."""
        return self.focal * seen[:, :2] / seen[:, 2:] + self.centre

    def rays(self, x, y):
        """Returns directions of pixels in camera axes, with z = 1."""
        return np.stack([(x - self.centre) / self.focal, (y - self.centre) / self.focal, np.ones_like(x)], axis=-1)


@dataclasses.dataclass(frozen=True)
class Detector:
    """Adds shot noise, read noise and quantisation. The brightest 0.5 % of the pixels reach 0.8 of the full well."""

    full_well_e: float = 20000.0
    read_noise_e: float = 20.0
    bits: int = 10

    @staticmethod
    def white(radiance):
        return max(float(np.percentile(radiance, 99.5)), 1e-12)

    def image(self, radiance, white, random):
        """Returns digital numbers. white: the radiance white() of a reference frame, the same for all flights."""
        electrons = radiance * np.float32(0.8 * self.full_well_e / white)
        noise = random.standard_normal(electrons.shape, np.float32)
        electrons = electrons + noise * np.sqrt(np.maximum(electrons, 0) + np.float32(self.read_noise_e**2))
        step = self.full_well_e / (2**self.bits - 1)
        return np.clip(np.round(electrons / step), 0, 2**self.bits - 1).astype(np.float32)


def averaged(image, factor):
    if factor == 1:
        return image
    side = image.shape[0] // factor * factor
    return cv2.resize(image[:side, :side], None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
