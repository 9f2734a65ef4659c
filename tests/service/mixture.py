"""Well-formed requests of every kind, for tests that send many at once. Needs terrain from harness.sample() with PLACE and the
folder of harness.assets()."""

import json
import math
import random

from harness import frame_request

PLACE = ("--south-deg", "-1", "--west-deg", "28", "--rows", "2", "--columns", "6", "--ppd", "512")
SOUTH, NORTH, WEST, EAST = -0.8, 0.8, 28.2, 33.8
RADIUS_M = 1737400.0


def unit(lat_deg, lon_deg):
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    return [math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)]


class Mixture:
    """Requests (method, path, headers, body), the same for the same seed. maps=False: for services whose --scene-mb differ,
    which is in a map's ETag."""

    def __init__(self, seed, most_pixels_a_side=96, maps=True):
        self.random = random.Random(seed)
        self.maps = maps
        self.most = most_pixels_a_side

    def place(self):
        return self.random.uniform(SOUTH, NORTH), self.random.uniform(WEST, EAST)

    def sun(self, lat, lon):
        return {"local": {"lat_deg": lat, "lon_deg": lon, "azimuth_deg": self.random.uniform(0, 360),
                          "elevation_deg": self.random.uniform(3, 60)}}

    def scene(self):
        """A camera anywhere over the terrain, looking down or towards another place."""
        lat, lon = self.place()
        frame = frame_request(width=self.random.randint(1, self.most), height=self.random.randint(1, self.most))
        height = math.exp(self.random.uniform(math.log(9e3), math.log(6e4)))
        pose = {"geodetic": {"lat_deg": lat, "lon_deg": lon, "height_m": height}}
        if self.random.random() < 0.6:
            pose["nadir"] = {"up_azimuth_deg": self.random.uniform(0, 360)}
        else:
            target_lat, target_lon = self.place()
            pose["look_at"] = {"lat_deg": target_lat, "lon_deg": target_lon, "height_m": 0.0}
        return {"camera": frame["camera"], "pose": pose, "sun": self.sun(lat, lon)}

    @staticmethod
    def post(path, document, accept="application/json"):
        return "POST", path, {"Content-Type": "application/json", "Accept": accept}, json.dumps(document).encode()

    def things(self, scene):
        """A satellite below the camera, maps of the ground, both or none."""
        more = {}
        if self.random.random() < 0.3:
            place = dict(scene["pose"]["geodetic"], height_m=scene["pose"]["geodetic"]["height_m"] - self.random.uniform(50, 3000))
            more["objects"] = [{"mesh": "satellite", "scale": self.random.uniform(1, 100), "pose": {"geodetic": place, "upright": {}},
                                "material": {"reflectance": {"model": "lambert"}}}]
        if self.random.random() < 0.3:
            more["surface"] = {"albedo_maps": ["made-up-albedo", "everywhere"]}
        return dict(more, **self.detail())

    def detail(self, places=1):
        """Craters, relief and rocks below the posts; mostly not, and not where the ground is made at many places."""
        return {"detail": "landing"} if self.random.random() < 0.2 and places <= 5 else {}

    def frame(self):
        products, accept = self.random.choice([
            (["radiance"], "application/octet-stream"), (["image"], "image/png"), (["depth"], "application/x-npy"),
            (["position", "lit", "source"], "application/x-npz"), (["normal"], "image/tiff"), (["angles", "gsd"], "image/x-exr")])
        visibility = self.random.choice(["auto", "zbuffer", "raytrace"])
        scene = self.scene()
        return self.post("/v1/frames", dict(scene, products=products, visibility=visibility, **self.things(scene)), accept)

    def rays(self):
        rays = []
        for _ in range(self.random.randint(1, 40)):
            up = unit(*self.place())
            rays.append({"origin_m": [(RADIUS_M + 5e4) * x for x in up], "direction": [-x for x in up]})
        lat, lon = self.place()
        return self.post("/v1/rays", {"rays": rays, "sun": self.sun(lat, lon), **self.detail(len(rays))})

    def points(self, most):
        return [dict(zip(("lat_deg", "lon_deg"), self.place())) for _ in range(self.random.randint(1, most))]

    def project(self):
        points = self.points(20)
        return self.post("/v1/project", dict(self.scene(), points=points, **self.detail(len(points))))

    def heights(self):
        return self.post("/v1/heights", {"points": self.points(40), **self.detail()})

    def map(self):
        lat, lon = self.place()
        side_m = math.exp(self.random.uniform(math.log(2e3), math.log(2e4)))
        area = {"projection": self.random.choice(["orthographic", "equirectangular"]), "center": {"lat_deg": lat, "lon_deg": lon},
                "width_m": side_m, "height_m": side_m, "gsd_m": side_m / self.random.randint(4, self.most)}
        products, accept = self.random.choice([(["height", "slope"], "application/x-npz"), (["radiance"], "image/tiff"), (["lit"], "image/png")])
        return self.post("/v1/maps", dict(self.detail(), map=area, products=products, sun=self.sun(lat, lon)), accept)

    def features(self):
        lat, lon = self.place()
        half_deg = self.random.uniform(1e-4, 2e-3)
        box = {"south_deg": lat - half_deg, "north_deg": lat + half_deg, "west_deg": lon - half_deg, "east_deg": lon + half_deg}
        return self.post("/v1/features", {"detail": "landing", "region": box, "kind": self.random.choice(["craters", "rocks"]),
                                          "smallest_m": self.random.uniform(1, 20)}, self.random.choice(["application/json", "text/csv"]))

    def get(self):
        lat, lon = self.place()
        return "GET", self.random.choice([f"/v1/height?lat_deg={lat}&lon_deg={lon}", "/v1/datasets", "/openapi.json"]), {}, None

    def next(self):
        kinds, weights = (self.frame, self.rays, self.project, self.heights, self.map, self.features, self.get), (8, 3, 3, 2, 2 if self.maps else 0, 1, 2)
        return self.random.choices(kinds, weights)[0]()
