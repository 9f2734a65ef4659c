"""The requests of compare_binaries.py, and the terrain and assets that they are about.

Small images, but together of everything that a request can ask for: whatever stage changes, the bytes of some answer do.
"""

import copy
import json
import os
import shutil
import subprocess
from dataclasses import dataclass, field

import harness
import mixture

GEOMETRY = ["depth", "range", "position", "geodetic", "normal", "angles", "lit", "gsd", "source"]
ALL = ["image", "radiance", *GEOMETRY, "object_id"]
NPZ = "application/x-npz"


@dataclass
class Request:
    name: str
    method: str
    path: str
    headers: dict = field(default_factory=dict)
    document: dict = None
    body: bytes = None  # instead of a document
    status: int = 200

    def ask(self, service):
        body = self.body if self.document is None else json.dumps(self.document).encode()
        connection = service.connect(timeout=600)  # the first has to wait for the pyramid
        try:
            return service.ask(self.method, self.path, body, self.headers, connection)
        finally:
            connection.close()


def places(ppd):
    """Sample terrain, with a part at the date line and all longitudes at a pole."""
    return (("--south-deg", "-8", "--west-deg", "39", "--rows", "3", "--columns", "2", "--date-line", "--ppd", str(ppd)),
            ("--south-deg", "89", "--west-deg", "0", "--rows", "1", "--columns", "360", "--ppd", "64"))


def write_files(binary, terrain=(*places(512), mixture.PLACE)):
    """Sample terrain below harness.path("dem"), assets below harness.path("assets")."""
    done = harness.path("dem", ".complete")
    if not os.path.exists(done):
        shutil.rmtree(harness.path("dem"), ignore_errors=True)
        for place in terrain:
            subprocess.run([binary, "sample", harness.path("dem"), *place], check=True, stdout=subprocess.DEVNULL)
        open(done, "w").close()
    shutil.rmtree(harness.path("assets"), ignore_errors=True)
    harness.assets()
    with open(harness.path("assets", "maps", "warm.asc"), "w") as file:
        rows = [" ".join(str(200 + 7 * ((3 * row + column) % 19)) for column in range(24)) for row in range(24)]
        file.write("ncols 24\nnrows 24\nxllcorner 39\nyllcorner -8\ncellsize 0.125\n" + "\n".join(rows) + "\n")
    with open(harness.path("assets", "maps", "warm.json"), "w") as file:
        json.dump({"file": "warm.asc", "extent": {"south_deg": -8, "north_deg": -5, "west_deg": 39, "east_deg": 42}}, file)


def place(lat_deg, lon_deg, **more):
    return {"lat_deg": lat_deg, "lon_deg": lon_deg, **more}


def sun(elevation_deg, azimuth_deg=100, lat_deg=-6.5, lon_deg=40.0, **more):
    return {"local": place(lat_deg, lon_deg, azimuth_deg=azimuth_deg, elevation_deg=elevation_deg), **more}


def nadir(height_m, lat_deg=-6.55, lon_deg=39.95, up_azimuth_deg=20):
    return {"geodetic": place(lat_deg, lon_deg, height_m=height_m), "nadir": {"up_azimuth_deg": up_azimuth_deg}}


def toward(lat_deg, lon_deg, height_m, target_lat_deg, target_lon_deg, target_height_m=0.0):
    return {"geodetic": place(lat_deg, lon_deg, height_m=height_m),
            "look_at": place(target_lat_deg, target_lon_deg, height_m=target_height_m)}


def camera(side=256, fov_deg=50, height=None, **more):
    return {"width": side, "height": height or side, "fov_deg": fov_deg, **more}


def document(products=("radiance", *GEOMETRY), **changes):
    return {"camera": camera(), "pose": nadir(30e3), "sun": sun(15), "products": list(products), **changes}


def frame(name, products=("radiance", *GEOMETRY), accept=NPZ, status=200, **changes):
    headers = {"Content-Type": "application/json", "Accept": accept}
    return Request(name, "POST", "/v1/frames", headers, document(products, **changes), status=status)


def by_both(name, **changes):
    return [frame(f"{name}, {how}", visibility=how, **changes) for how in ("zbuffer", "raytrace")]


LENS = {"model": "brown_conrady", "k1": -0.18, "k2": 0.04, "k3": -0.003, "p1": 0.004, "p2": -0.002}
SATELLITE = {"mesh": "satellite", "scale": 60,
             "pose": {"geodetic": place(-6.55, 39.95, height_m=28e3), "upright": {"azimuth_deg": 60}},
             "material": {"reflectance": {"model": "lambert", "rho": 0.3}, "temperature_k": 290},
             "part_materials": {"panel": {"reflectance": {"model": "blinn_phong", "rho": 0.4, "shininess": 100}}}}
SECOND = {"mesh": "satellite", "scale": 900,
          "pose": {"frame": "MOON_PA_DE440", "position_m": [1328e3, 1106e3, -194e3], "object_from_moon": {"w": 0.5, "x": 0.5, "y": -0.5, "z": 0.5}},
          "material": {"reflectance": {"model": "lunar", "lommel_seeliger_weight": 0.4, "rho": 0.2}}}
NOISE = {
    "optics": {"f_number": 5.6, "point_spread": {"model": "gaussian", "sigma_px": 0.8}, "vignetting": {"model": "cos4"}},
    "detector": {"pixel_pitch_um": 5.5, "quantum_efficiency": 0.45, "integration_time_s": 0.002, "full_well_e": 13500,
                 "dark_current_e_s": 125, "smear_time_s": 1e-6, "read_noise_e": 13, "prnu": 0.01, "dsnu_e": 4, "dead_fraction": 1e-3,
                 "hot_fraction": 1e-3, "hot_current_e_s": 5e5, "gain_e_dn": 3.4, "offset_dn": 40, "bit_depth": 12, "photon_noise": True},
    "motion": {"angular_rate_deg_s": [3, -20, 40], "velocity_m_s": [400, 900, -1500], "samples": 3},
    "seed": 7, "frame": 11,
}
VISIBLE = {"center_um": 0.65, "width_um": 0.3}


def sensor(optics=(), **changes):
    changed = copy.deepcopy(NOISE)
    changed["optics"].update(optics)
    changed.update(changes)
    return {name: value for name, value in changed.items() if value is not None}


def surface(model, **more):
    return {"reflectance": {"model": model, **more}}


def frames(ground_m):
    """The frames. ground_m: height of the ground below the lowest camera."""
    debris = json.load(open(os.path.join(harness.REPOSITORY, "deploy", "examples", "debris-request.json")))
    alone = {name: debris[name] for name in ("pose", "sun", "objects", "terrain")}
    yield from by_both("nadir, all products", products=ALL, objects=[SATELLITE])
    yield frame("nadir, chosen by itself", camera=camera(320, height=200))
    yield from by_both("oblique", camera=camera(384, 40, 288), pose=toward(-7.6, 39.6, 20e3, -6.5, 40.0))
    yield from by_both("limb", camera=camera(320, 0.15, 200), pose=toward(-6.5, -44.0, 2e7, -6.5, 40.0))
    horizon = toward(-6.9, 39.7, ground_m + 2, -6.4, 39.9, ground_m)
    yield from by_both("horizon from 2 m", camera=camera(320, 70, 200), pose=horizon)
    yield from by_both("far", camera=camera(256, 0.02), pose=nadir(4e8, -6.5, 40.0))
    yield from by_both("pole", pose=nadir(40e3, 89.8, 30), sun=sun(2, 45, 89.5, 20))
    yield from by_both("date line", pose=nadir(25e3, -7.5, 180.0), sun=sun(20, 60, -7.5, 180.0))
    yield from by_both("low Sun", sun=sun(1.5, 75), accuracy={"max_shadow_error_px": 0})
    yield from by_both("penumbra", sun=sun(8, 250, angular_radius_deg=0.27, limb_darkening=0.6, distance_au=0.99))
    yield from by_both("lens", camera=camera(256, 60, distortion=LENS))
    yield frame("lens beyond its fold", camera=camera(256, 110, distortion={"model": "brown_conrady", "k1": -0.3}))
    yield from by_both("sub-pixel samples", accuracy={"samples_per_pixel": 9, "max_error_px": 0.2}, camera=camera(160))
    yield frame("lens, penumbra, samples", camera=camera(128, 60, distortion=LENS), accuracy={"samples_per_pixel": 4},
                sun=sun(8, angular_radius_deg=0.27))
    yield from by_both("finest posts", accuracy={"max_error_px": 0})
    yield frame("coarse posts", accuracy={"max_error_px": 8})
    yield frame("tiny", camera=camera(5, 50, 3), accuracy={"max_error_px": 0.001})
    yield frame("intrinsics, OpenGL axes, subsolar", camera={"width": 200, "height": 160, "fx": 300, "fy": 280, "cx": 90, "cy": 85.5},
                pose={"frame": "MOON_PA_DE421", "position_m": [1365e3, 1146e3, -231e3], "axes": "opengl",
                      "moon_from_camera": {"w": 0.2019, "x": 0.3988, "y": 0.7981, "z": 0.4040}},
                sun={"subsolar": place(1.5, 95)})
    yield frame("attitude by quaternion", pose={"position_m": [1360e3, 1141e3, -202e3], "axes": "opengl",
                                                "camera_from_moon": {"w": 0.5, "x": -0.5, "y": -0.5, "z": -0.5}},
                sun={"utc": "2026-11-20T00:00:00Z"})
    for name, ground in (("Lambert", surface("lambert", rho=0.2)), ("Lommel-Seeliger", surface("lommel_seeliger")),
                         ("average", surface("lunar", lommel_seeliger_weight=0.3)),
                         ("Blinn-Phong", surface("blinn_phong", shininess=40)), ("lunar-Lambert", surface("lunar_lambert")),
                         ("lunar-Lambert, fixed", surface("lunar_lambert", limb_darkening=0.25)), ("Hapke", surface("hapke")),
                         ("Hapke, Henyey-Greenstein", surface("hapke", phase_function="double_henyey_greenstein", theta_bar_deg=0))):
        yield frame(f"reflectance: {name}", ["radiance"], surface=ground)
    yield from by_both("Hapke oblique, samples", products=["radiance"], surface=surface("hapke"), accuracy={"samples_per_pixel": 4},
                       pose=toward(-7.6, 39.6, 20e3, -6.5, 40.0))
    yield frame("band", ["radiance", "image"], band=VISIBLE)
    yield frame("atmosphere, warm ground", ["radiance"], band={"response": [[0.5, 0.2], [0.55, 1], [0.6, 0.1]]},
                atmosphere={"name": "made-up-clear-sky"}, surface={"temperature_k": 300})
    yield frame("thermal band", ["radiance"], band={"center_um": 10, "width_um": 2}, surface={"temperature_k": 250})
    yield from by_both("maps", products=["radiance"], band={"center_um": 8, "width_um": 2},
                       surface={"albedo_maps": ["made-up-albedo", "everywhere"], "temperature_maps": ["warm"], "temperature_k": 150})
    yield frame("maps, samples", ["radiance"], surface={"albedo_maps": ["made-up-albedo"]}, accuracy={"samples_per_pixel": 4})
    yield from by_both("objects", products=["radiance", *GEOMETRY, "object_id"], objects=[SATELLITE, SECOND], sun=sun(25))
    yield from by_both("objects, penumbra", products=["radiance", "lit", "object_id"], objects=[SATELLITE, SECOND],
                       sun=sun(25, angular_radius_deg=0.5))
    yield frame("objects alone", ["image", "radiance", "depth", "object_id"], **alone, camera=camera(256, 16, 192),
                accuracy={"samples_per_pixel": 4})
    yield from by_both("sensor: all noise, motion", products=["image", "radiance"], band=VISIBLE, sensor=NOISE)
    yield frame("sensor: Airy, vignetting by a table", ["image"], band=VISIBLE, sensor=sensor(
        {"point_spread": {"model": "airy"}, "vignetting": {"model": "table", "table": [[0, 1], [20, 0.7], [50, 0.2]]}}, motion=None))
    yield frame("sensor: measured kernel", ["image"], band=VISIBLE, sensor=sensor(
        {"point_spread": {"model": "kernel", "kernel": "made-up-coma"}, "vignetting": {"model": "none"}}, motion=None, frame=12))
    preset = frame("preset", ["image"], camera_preset="navigation-camera", sensor={"detector": {"integration_time_s": 0.002}})
    preset.document["camera"] = camera(256, 44)
    yield preset
    yield frame("image of 16 bits", ["image"], image={"bit_depth": 16, "full_scale_radiance": 60})
    for kind, product in (("image/png", "image"), ("image/tiff", "position"), ("application/x-npy", "normal"),
                          ("application/octet-stream", "geodetic")):
        yield frame(f"{product} as {kind}", [product], kind)
    yield frame("all as image/x-exr", ALL, "image/x-exr", objects=[SATELLITE])
    yield frame("PNG of 16 bits", ["image"], "image/png", image={"bit_depth": 16})
    yield frame("refused: members", status=422, surface=surface("hapke", rho=0.1), accuracy={"max_eror_px": 1})
    yield frame("refused: below the ground", status=422, pose=nadir(-9e3))


def queries():
    """Everything that is no frame."""
    headers = {"Content-Type": "application/json", "Accept": "application/json"}
    shots = [mixture.unit(-7.9 + 0.028 * i, 39.1 + 0.018 * i) for i in range(100)]
    rays = [{"origin_m": [1.79e6 * x for x in up], "direction": [-x + 0.1 * (i % 5 - 2) for x in up]} for i, up in enumerate(shots)]
    points = [place(-7.9 + 0.028 * i, 39.1 + 0.018 * i, **({"height_m": 100.0 * i} if i % 3 == 0 else {})) for i in range(100)]
    view = {"camera": camera(1024, 60, distortion=LENS), "pose": nadir(60e3)}
    center = {"center": place(-7.5, 39.5), "posts": 64}
    for name, path, asked in (
            ("rays", "/v1/rays", {"rays": rays, "sun": sun(10)}),
            ("project", "/v1/project", {**view, "points": points, "sun": sun(10)}),
            ("heights", "/v1/heights", {"points": [place(p["lat_deg"], p["lon_deg"]) for p in points] + [place(50, 50)]}),
            ("roundtrip, exact", "/v1/verify/roundtrip", center),
            ("roundtrip, camera", "/v1/verify/roundtrip", {**center, "mode": "camera", "footprint_ratio": 0.5, "height_m": 15000}),
            ("mertis", "/v1/verify/mertis", {})):
        yield Request(name, "POST", path, headers, asked)
    yield Request("height", "GET", "/v1/height?lat_deg=-6.5&lon_deg=40", {"Accept": "application/json"})
    yield Request("datasets", "GET", "/v1/datasets", {"Accept": "application/json"})
    yield Request("not JSON", "POST", "/v1/frames", headers, body=b"{", status=400)


def all_requests(service, count=0):
    """The first `count` of them; where there are not so many, random ones follow. 0: all that are listed here."""
    ground = service.ask("GET", "/v1/height?lat_deg=-6.9&lon_deg=39.7")[2]
    requests = [*frames(json.loads(ground)["height_m"]), *queries()]
    if count and count < len(requests):
        # Every so many of them: the first alone would be of one kind.
        return [requests[i * len(requests) // count] for i in range(count)]
    random = mixture.Mixture(1)
    while len(requests) < count:
        method, path, headers, body = random.next()
        if path != "/openapi.json":
            requests.append(Request(f"random {len(requests)}: {path}", method, path, headers, body=body, status=None))
    return requests
