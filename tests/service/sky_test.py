#!/usr/bin/env python3
"""POST /v1/sky over HTTP, and its places against astropy and ERFA in Python (skipped without python3-astropy)."""

import json
import math
import os
import random
import unittest

import numpy as np

import harness
from harness import Service, assets, path, sample

try:
    import astropy.units as u
    import erfa
    from astropy.coordinates import (GCRS, ICRS, CartesianRepresentation, SkyCoord, get_body_barycentric,
                                     solar_system_ephemeris)
    from astropy.time import Time
    from astropy.utils import iers
    iers.conf.auto_download = False
except ImportError:
    erfa = None

EPOCHS = ("2001-02-03T04:05:06", "2026-11-25T00:00:00", "2049-07-01T12:00:00")
HEAD = "id,ra_deg,dec_deg,epoch_yr,pm_ra_mas_yr,pm_dec_mas_yr,parallax_mas,v_mag,b_v"
# ICRF axes at the Moon's centre: a fisheye that sees all but a cone behind it.
POSITION_M, VELOCITY_M_S = [3.0e6, -2.0e7, 1.0e6], [1200.0, -800.0, 500.0]
EVERYTHING = {"camera": {"model": "fisheye", "width": 1024, "height": 1024, "fov_deg": 358.0},
              "pose": {"frame": "ICRF", "position_m": POSITION_M, "camera_from_moon": {"w": 1, "x": 0, "y": 0, "z": 0}},
              "utc": EPOCHS[1] + "Z", "sky": {"stars": "thousand"}}
PLANETS = ("mercury", "venus", "mars", "jupiter", "saturn", "uranus", "neptune")
service = None


def setUpModule():
    global service
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")
    folder, chance = assets(), random.Random(5)
    with open(os.path.join(folder, "stars", "thousand.csv"), "w", encoding="ascii") as file:
        print(HEAD, file=file)
        for i in range(1000):
            dec, pm = math.degrees(math.asin(2 * chance.random() - 1)), [chance.gauss(0, 300) for _ in range(2)]
            print(f"T{i},{360 * chance.random():.9f},{dec:.9f},{chance.choice((1991.25, 2000, 2016))},{pm[0]:.4f},"
                  f"{pm[1]:.4f},{abs(chance.gauss(0, 100)) + 0.1:.4f},{5 * chance.random():.3f},0.6", file=file)
    service = Service("--assets-dir", folder)


def tearDownModule():
    harness.tear_down()


def sky(**changes):
    status, _, body = service.post("/v1/sky", {**EVERYTHING, **changes})
    assert status == 200, body[:500]
    return json.loads(body)["objects"]


def unit(v):
    return np.asarray(v) / np.linalg.norm(v)


def arcsec(a, b):
    return math.degrees(math.asin(min(1, np.linalg.norm(np.cross(a, b))))) * 3600


class Answer(unittest.TestCase):
    def test_orion_among_the_bright_stars(self):
        with open(os.path.join(harness.REPOSITORY, "api", "endpoints", "examples.json"), encoding="utf-8") as file:
            orion = json.load(file)["/v1/sky"]["orion"]
        stars = {o["id"]: o for o in sky(**orion)}
        betelgeuse, rigel, bellatrix, saiph = (stars[f"HR {n}"] for n in (2061, 1713, 1790, 2004))
        self.assertLess(betelgeuse["y_px"], rigel["y_px"])  # north is up
        self.assertLess(betelgeuse["x_px"], bellatrix["x_px"])  # east is left
        self.assertLess(saiph["x_px"], rigel["x_px"])
        belt = [stars[f"HR {n}"] for n in (1948, 1903, 1852)]  # Alnitak, Alnilam, Mintaka
        self.assertEqual(sorted(belt, key=lambda o: o["x_px"]), belt)
        self.assertTrue(all(o["visible"] for o in stars.values() if o["kind"] == "star"))

    def test_npz_has_what_json_has(self):
        what = {"stars": "thousand", "earth": True, "sun": True, "planets": True}
        objects = sky(sky=what)
        arrays = service.arrays({**EVERYTHING, "sky": what}, "/v1/sky")
        self.assertEqual(arrays["meta"]["id"], [o["id"] for o in objects])
        self.assertEqual(arrays["meta"]["kind"][-9:], ["sun", "earth"] + 7 * ["planet"])
        for name in ("direction_icrf", "direction", "direction_camera"):
            self.assertEqual(arrays[name].tolist(), [o[name] for o in objects])
        self.assertEqual(arrays["magnitude"][:, 0].tolist(), [o["magnitude"] for o in objects])

    def test_what_is_wrong_is_said(self):
        for changes, pointer in (({"utc": None}, ""), ({"utc": "2026-13-01T00:00:00Z"}, "/utc"),
                                 ({"sky": {"stars": "nowhere"}}, "/sky/stars"),
                                 ({"sky": {"magnitude": 4}}, "/sky/magnitude"),
                                 ({"sky": None}, "/sky")):
            document = {k: v for k, v in {**EVERYTHING, **changes}.items() if v is not None}
            status, _, body = service.post("/v1/sky", document)
            self.assertEqual(status, 422, body)
            self.assertIn(pointer, [error["pointer"] for error in json.loads(body)["errors"]], body)

    def test_a_frame_needs_an_epoch_for_its_sky(self):
        request = harness.frame_request(sky={"stars": True})
        status, _, body = service.frame(request)
        self.assertEqual((status, json.loads(body)["errors"][0]["pointer"]), (422, "/sky"), body)
        self.assertEqual(service.frame({**request, "sky": {"stars": True, "utc": EPOCHS[0]}})[0], 200)

    def test_a_broken_catalogue_is_named_with_its_line(self):
        with open(path("assets", "stars", "broken.csv"), "w", encoding="ascii") as file:
            file.write(f"{HEAD}\nA,1,2,2000,0,0,0,4,x\n")
        status, _, body = service.post("/v1/sky", {**EVERYTHING, "sky": {"stars": "broken"}})
        self.assertEqual(status, 500)
        self.assertIn(b"broken.csv: line 2", body)


@unittest.skipUnless(erfa, "needs python3-astropy")
class AgainstAstropy(unittest.TestCase):
    worst = {}

    def observer(self, epoch):
        """Position and velocity from the Earth's centre, m and m/s: ERFA's Moon and the camera's."""
        time = Time(epoch, scale="utc")
        moon = erfa.moon98(time.tt.jd1, time.tt.jd2)
        return time, moon["p"] * u.au.to(u.m) + POSITION_M, moon["v"] * (u.au / u.day).to(u.m / u.s) + VELOCITY_M_S

    def asked(self, epoch, **what):
        return {o["id"]: o for o in
                sky(utc=epoch + "Z", sky={"velocity_m_s": VELOCITY_M_S, "velocity_frame": "ICRF", **what})}

    def frame(self, epoch):
        time, place, motion = self.observer(epoch)
        return GCRS(obstime=time, obsgeoloc=CartesianRepresentation(place * u.m),
                    obsgeovel=CartesianRepresentation(motion * u.m / u.s))

    def test_a_thousand_stars_at_three_epochs(self):
        with open(path("assets", "stars", "thousand.csv"), encoding="ascii") as file:
            lines = [line.split(",") for line in file if line.startswith("T")]
        rows = {name: [float(x) for x in numbers] for name, *numbers in lines}
        worst = 0
        for epoch in EPOCHS:
            frame = self.frame(epoch)
            answers = self.asked(epoch, stars="thousand")
            self.assertGreater(len(answers), 990)
            for of_epoch in (1991.25, 2000.0, 2016.0):
                names = [n for n in answers if rows[n][2] == of_epoch]
                table = np.array([rows[n] for n in names])
                stars = SkyCoord(ra=table[:, 0] * u.deg, dec=table[:, 1] * u.deg,
                                 pm_ra_cosdec=table[:, 3] * u.mas / u.yr,
                                 pm_dec=table[:, 4] * u.mas / u.yr, distance=(1000 / table[:, 5]) * u.pc,
                                 obstime=Time(of_epoch, format="jyear", scale="tdb"), frame=ICRS)
                seen = stars.apply_space_motion(new_obstime=frame.obstime).transform_to(frame)
                for name, direction in zip(names, seen.cartesian.xyz.value.T):
                    worst = max(worst, arcsec(unit(direction), answers[name]["direction_icrf"]))
        print(f"stars: {worst:.6f} arcsec at most")
        self.assertLess(worst, 0.01)

    def test_sun_and_earth_are_where_astropy_has_them(self):
        """Its built-in ephemeris and its aberration; phases from its places. It bends the Earth's light as a star's."""
        worst, worst_deg = 0, 0
        for epoch in EPOCHS:
            frame = self.frame(epoch)
            answers = self.asked(epoch, sun=True, earth=True)
            with solar_system_ephemeris.set("builtin"):
                def at(body, seconds):
                    return get_body_barycentric(body, frame.obstime - seconds * u.s).xyz.to_value(u.m)
                here, ways = at("earth", 0) + frame.obsgeoloc.xyz.to_value(u.m), {}
                for name in ("sun", "earth"):
                    seconds = 0
                    for _ in range(4):
                        ways[name] = at(name, seconds) - here
                        seconds = np.linalg.norm(ways[name]) / 299792458.0
                    seen = ICRS(CartesianRepresentation((ways[name] + here) * u.m)).transform_to(frame)
                    worst = max(worst, arcsec(unit(seen.cartesian.xyz.value), answers[name]["direction_icrf"]))
            phase = math.degrees(math.acos(unit(ways["sun"] - ways["earth"]) @ unit(-ways["earth"])))
            worst_deg = max(worst_deg, abs(phase - answers["earth"]["phase_deg"]))
        print(f"Sun and Earth: {worst:.4f} arcsec, {worst_deg:.5f} degrees of phase at most")
        self.assertLess(worst, 0.1)
        self.assertLess(worst_deg, 0.1)

    def test_sun_earth_and_planets(self):
        """The same theories, with light time and aberration worked out here."""
        worst = 0
        for epoch in EPOCHS:
            time, place, motion = self.observer(epoch)
            jd1, jd2, au = time.tt.jd1, time.tt.jd2, u.au.to(u.m)

            def earth_and_sun(days_before):
                from_sun, from_barycentre = erfa.epv00(jd1, jd2 - days_before)
                return from_barycentre, from_barycentre["p"] - from_sun["p"]

            now = earth_and_sun(0)[0]
            here = now["p"] * au + place
            beta = (now["v"] * (u.au / u.day).to(u.m / u.s) + motion) / 299792458.0
            places = {"sun": lambda days: earth_and_sun(days)[1], "earth": lambda days: earth_and_sun(days)[0]["p"]}
            for number, name in zip((1, 2, 4, 5, 6, 7, 8), PLANETS):
                places[name] = lambda days, n=number: earth_and_sun(days)[1] + erfa.plan94(jd1, jd2 - days, n)["p"]
            answers = self.asked(epoch, sun=True, earth=True, planets=True)
            for name, barycentric in places.items():
                days = 0
                for _ in range(4):
                    way = barycentric(days) * au - here
                    days = np.linalg.norm(way) / 299792458.0 / 86400
                natural = unit(way)
                seen = unit(natural / (1 + natural @ beta) * math.sqrt(1 - beta @ beta) +
                            (1 + natural @ beta / (1 + math.sqrt(1 - beta @ beta))) / (1 + natural @ beta) * beta)
                worst = max(worst, arcsec(seen, answers[name]["direction_icrf"]))
                if name == "sun":
                    continue
                from_sun = barycentric(days) * au - earth_and_sun(days)[1] * au
                phase = math.degrees(math.acos(np.clip(unit(from_sun) @ natural, -1, 1)))
                self.assertAlmostEqual(phase, answers[name]["phase_deg"], delta=0.001, msg=name)
        print(f"bodies: {worst:.6f} arcsec at most")
        self.assertLess(worst, 0.1)


if __name__ == "__main__":
    harness.main()
