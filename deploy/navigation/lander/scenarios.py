"""Where the lander flies, and under which Suns."""

import dataclasses

from .camera import Camera
from .descent import Descent


@dataclasses.dataclass(frozen=True)
class Scenario:
    name: str
    descent: Descent
    camera: Camera
    flight_sun: dict
    map_sun: dict
    sample: tuple = ()  # options of `selenograph sample`; empty: a folder of the shared data, `site` or named so
    site: str = ""
    detail: str | None = None  # below the posts, in frames and map: a preset of deploy/assets/details
    map_gsd_m: float = 0.0  # of the finest level, with detail; without it is a third of the posts
    surface: dict = dataclasses.field(default_factory=lambda: {"preset": "moon"})  # in frames and map
    frame_step_s: float = 1.0
    imu_step_s: float = 0.1


def _sun(lat_deg, lon_deg, azimuth_deg, elevation_deg, **more):
    return {"local": {"lat_deg": lat_deg, "lon_deg": lon_deg, "azimuth_deg": azimuth_deg,
                      "elevation_deg": elevation_deg}, **more}


def sample(side=512, flight=(95, 18), map_sun=(105, 30)):
    """All of a braking phase from 15 km and 1690 m/s, 480 km eastward along the equator of the sample terrain."""
    site, middle = (0.05, 36.5), (0.05, 28.5)  # the Sun's elevation differs by 8 degrees at both ends
    return Scenario("sample", Descent(*site, 1275.0, 90.0, 480e3, 1690.0), Camera.of(side, 50.0),
                    _sun(*middle, *flight), _sun(*middle, *map_sun),
                    ("--south-deg", "-1", "--west-deg", "20", "--rows", "2", "--columns", "17", "--ppd", "1024"))


def short(side=256, flight=(95, 18), map_sun=(105, 30)):
    """For the test: 200 frames at 2 Hz, the last 100 s of a braking phase, over four tiles."""
    site = (0.05, 30.6)
    return Scenario("short", Descent(*site, 0.0, 90.0, 30e3, 570.0, perilune_m=8000.0), Camera.of(side, 50.0),
                    _sun(*site, *flight), _sun(*site, *map_sun),
                    ("--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns", "2", "--ppd", "1024"),
                    frame_step_s=0.5)


def hadley(side=512, flight=(95, 18), map_sun=(105, 30)):
    """The last 200 km to Apollo 15's site, westward over the Apennines as it flew: the tiles reach no farther."""
    site = (26.1322, 3.6339)
    return Scenario("hadley", Descent(*site, -1922.0, 276.0, 200e3, 1100.0), Camera.of(side, 50.0),
                    _sun(*site, *flight), _sun(*site, *map_sun))


def touchdown(side=512, flight=(95, 18), map_sun=(105, 30), detail="landing"):
    """As over Hadley, but down to 100 m, with craters and rocks below the posts. The map shows them (but no rocks) in
    pixels of 0.85 m, as images from orbit do."""
    site = (26.1322, 3.6339)
    descent = Descent(*site, -1922.0, 276.0, 200e3, 1100.0, end_altitude_m=100.0, end_speed_m_s=5.0,
                      end_descent_m_s=4.0)
    return Scenario("touchdown" if detail else "touchdown-plain", descent, Camera.of(side, 50.0),
                    _sun(*site, *flight), _sun(*site, *map_sun), site="hadley", detail=detail,
                    map_gsd_m=0.5 if detail else 0.0)


def touchdown_plain(**more):
    """The same without anything below the posts."""
    return touchdown(**more, detail=None)


ALL = {"sample": sample, "hadley": hadley, "short": short, "touchdown": touchdown,
       "touchdown-plain": touchdown_plain}


def coarser(scenario, times):
    """With sample terrain of fewer posts."""
    options = list(scenario.sample)
    posts_per_degree = int(options[options.index("--ppd") + 1])
    options[options.index("--ppd") + 1] = str(posts_per_degree // times)
    return dataclasses.replace(scenario, name=f"{scenario.name}-{times}", sample=tuple(options))


# Terrain alone: what `run approach` flies to. Of the shared data, the DEM of the whole Moon.
APPROACH = Scenario("approach", None, None, {}, {}, site="global")
