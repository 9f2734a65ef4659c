#!/usr/bin/env python3
"""Writes the seeds of the fuzz targets: small inputs that reach each branch once. Run it after adding one; commit both.

Standard library only. Inputs that fuzzing itself found worth keeping lie beside them as found-*; this leaves them alone.
"""

import base64
import itertools
import json
import os
import struct

HERE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "corpus")


def write(target, name, content):
    os.makedirs(os.path.join(HERE, target), exist_ok=True)
    with open(os.path.join(HERE, target, name), "wb") as file:
        file.write(content if isinstance(content, bytes) else content.encode())


# --- JSON ------------------------------------------------------------------------------------------------------------

CAMERAS = {
    "fov": {"model": "pinhole", "width": 8, "height": 6, "fov_deg": 40.0},
    "intrinsics": {"width": 8, "height": 6, "fx": 9.5, "fy": 9, "cx": 3.5, "cy": 2},
    "lens": {"width": 8, "height": 6, "fx": 9.5,
             "distortion": {"model": "brown_conrady", "k1": -0.2, "k2": 0.03, "k3": -1e-3, "p1": 1e-4, "p2": -1e-4}},
}
POSES = {
    "nadir": {"geodetic": {"lat_deg": 26.1, "lon_deg": 3.6, "height_m": 20000}, "nadir": {"up_azimuth_deg": 30}},
    "look-at": {"position_m": [1757400, 0, 1000.5], "look_at": {"lat_deg": 1, "lon_deg": 359, "height_m": -50, "up": "north"}},
    "look-at-vector": {"position_m": [0, 1757400, 0], "look_at": {"lat_deg": 0, "lon_deg": 90.5, "up": [0, 1e-300, 1e300]}},
    "quaternion": {"frame": "MOON_PA_DE440", "position_m": [1757400, 0, 0], "camera_from_moon": {"w": -0.5, "x": 0.5, "y": 0.5, "z": 0.5}},
    "inverse": {"frame": "MOON_PA_DE421", "position_m": [-1e12, 1, 2], "axes": "opengl",
                "moon_from_camera": {"w": 0.70710678, "x": 0, "y": -0.70710678, "z": 0}},
}
SUNS = {
    "direction": {"direction": [0, 1, 0.2], "distance_au": 1.01, "angular_radius_deg": 0.2666},
    "subsolar": {"subsolar": {"lat_deg": 1.5, "lon_deg": 60}},
    "local": {"local": {"lat_deg": 26, "lon_deg": 3, "azimuth_deg": 90, "elevation_deg": 15}},
    "utc": {"utc": "2026-11-20T00:00:00.5Z"},
}
OTHERS = {
    "none": {},
    "lunar": {"surface": {"reflectance": {"model": "lunar", "lommel_seeliger_weight": 0.7, "rho": 0.12}},
              "accuracy": {"max_error_px": 0.5, "samples_per_pixel": 16}, "products": ["radiance", "image", "lit"],
              "image": {"bit_depth": 16, "full_scale_radiance": 55.5}},
    "lambert": {"surface": {"reflectance": {"model": "lambert"}}, "image": {"full_scale_radiance": "auto"},
                "products": ["depth", "range", "position", "geodetic", "normal", "angles", "gsd", "source"]},
    "objects": {"surface": {"reflectance": {"model": "lunar_lambert", "rho": 0.2}, "albedo_maps": ["made-up-albedo"],
                            "temperature_k": 250.5, "temperature_maps": ["made-up-albedo"]},
                "objects": [{"mesh": "satellite", "scale": 2.5, "material": {"reflectance": {"model": "lambert"}, "temperature_k": 300},
                             "pose": {"geodetic": {"lat_deg": 1, "lon_deg": 2, "height_m": 3}, "upright": {"azimuth_deg": 4}},
                             "part_materials": {"panel": {"reflectance": {"model": "blinn_phong", "shininess": 50}}, "body": {}}},
                            {"mesh": "satellite", "material": {}, "pose": {"frame": "MOON_PA_DE421", "position_m": [1, 2, 3],
                             "object_from_moon": {"w": 0, "x": -0.6, "y": 0.8, "z": 0}}}],
                "terrain": False, "products": ["object_id", "radiance"]},
}
CENTER = {"center": {"lat_deg": -89.5, "lon_deg": 200}, "width_m": 300, "height_m": 200, "gsd_m": 50}
MAPS = {
    "bounds": {"projection": "equirectangular", "gsd_m": 1e4,
               "bounds": {"south_deg": -2, "north_deg": 1.5, "west_deg": 170, "east_deg": -175}},
    "polar": {"projection": "polar_stereographic", **CENTER},
    "orthographic": {"projection": "orthographic", **CENTER},
}
MOON = {"south_deg": -90, "north_deg": 90, "west_deg": -180, "east_deg": 180}
EXTREMES = {"denormal": 5e-324, "normal": 2.3e-308, "largest": 1.7976931348623157e308, "below-zero": -5e-324}
WRONG = {
    "twice": '{"products": ["depth"], "products": ["depth"]}',
    "nan": '{"camera": NaN}',
    "overflow": '{"rays": [{"origin_m": [1e999, 0, 0], "direction": [0, 0, 1]}]}',
    "deep": "[" * 20 + "]" * 20,
    "unicode": '{"c\\u00e4m\\ud83c\\udf19": "\\\\/~", "a/b~c": [null, true, false, -0.0, 1E-400]}',
    "misspelt": '{"camra": {}, "pose": {"position": [1, 2, 3]}, "sun": 7, "products": ["raidance", "lit", "lit"]}',
    "both": '{"camera": {"width": 8, "height": 8, "fov_deg": 5, "fx": 6}, "pose": {"nadir": {}, "look_at": {}}, "sun": {}}',
    "truncated": '{"camera": {"width": 8, "hei',
}


def write_json():
    kinds = itertools.zip_longest(CAMERAS.items(), POSES.items(), SUNS.items(), OTHERS.items())
    chosen = [list(CAMERAS.items())[0], list(POSES.items())[0], list(SUNS.items())[0], list(OTHERS.items())[0]]
    for name, area in MAPS.items():
        write("json_request", f"map-{name}.json",
              json.dumps({"map": area, "sun": SUNS["utc"], "view": {"direction": [0, 1, 2]}, "products": ["lit", "height", "radiance"]}))
    for row in kinds:
        chosen = [new or old for new, old in zip(row, chosen)]
        names, (camera, pose, sun, other) = zip(*chosen)
        frame = {"camera": camera, "pose": pose, "sun": sun, **other}
        write("json_request", "frame-" + "-".join(names) + ".json", json.dumps(frame))
        project = {"camera": camera, "pose": pose, "points": [{"lat_deg": 26, "lon_deg": -3}, {"lat_deg": 1, "lon_deg": 2, "height_m": 3}]}
        write("json_request", f"project-{names[1]}.json", json.dumps(project))
    camera, pose, sun = CAMERAS["fov"], POSES["nadir"], SUNS["direction"]
    rates = {"line_time_s": 0.001, "velocity_m_s": [0, 1600, 0], "angular_rate_deg_s": [0.05, 0, 0]}
    poses = {"line_time_s": 0.001, "pushbroom": True,
             "poses": [{"time_s": -1, "pose": pose}, {"time_s": 0.5, "pose": POSES["look-at"]}, {"time_s": 20, "pose": pose}]}
    points = [{"lat_deg": 26, "lon_deg": 3}]
    write("json_request", "frame-rolling.json", json.dumps({"camera": camera, "pose": pose, "sun": sun, "shutter": rates}))
    write("json_request", "frame-pushbroom.json", json.dumps({"camera": camera, "sun": sun, "shutter": poses}))
    write("json_request", "project-pushbroom.json", json.dumps({"camera": camera, "points": points, "shutter": poses}))
    rays = {"rays": [{"origin_m": [1757400, 0, 0], "direction": [-1, 0, 1e-9]}], "sun": SUNS["direction"]}
    write("json_request", "rays.json", json.dumps(rays))
    write("json_request", "heights.json", json.dumps({"points": [{"lat_deg": -90, "lon_deg": 360}, {"lat_deg": 0.5, "lon_deg": -180}]}))
    for name, number in EXTREMES.items():
        for kind in ("craters", "rocks"):
            features = {"detail": "landing", "kind": kind, "region": MOON, "smallest_m": number}
            write("json_request", f"features-{kind}-{name}.json", json.dumps(features))
        camera = {"width": 8, "height": 6, "fx": number, "cx": number, "distortion": {"model": "brown_conrady", "k1": number}}
        pole = {"geodetic": {"lat_deg": 90, "lon_deg": 20, "height_m": number}, "nadir": {"up_azimuth_deg": number}}
        sun = {"local": {"lat_deg": -90, "lon_deg": 20, "azimuth_deg": 0, "elevation_deg": number}, "distance_au": number}
        write("json_request", f"frame-pole-{name}.json", json.dumps({"camera": camera, "pose": pole, "sun": sun}))
        area = {"projection": "orthographic", "center": {"lat_deg": -90, "lon_deg": 20}, "width_m": number, "height_m": 200, "gsd_m": 50}
        write("json_request", f"map-pole-{name}.json", json.dumps({"map": area, "sun": sun}))
        write("json_request", f"rays-{name}.json", json.dumps({"rays": [{"origin_m": [number, 0, 0], "direction": [number, 0, 0]}]}))
    write("json_request", "mertis.json", json.dumps({"first_um": 7, "last_um": 14, "channels": 20, "efficiency": [[7, 0.3], [14, 0.4]]}))
    write("json_request", "roundtrip.json", json.dumps({"center": {"lat_deg": -90, "lon_deg": 20}, "height_m": 2000, "posts": 8}))
    for name, text in WRONG.items():
        write("json_request", f"wrong-{name}.json", text)


# --- PDS3 ------------------------------------------------------------------------------------------------------------

KAGUYA = """PDS_VERSION_ID = "PDS3" /* a comment */
MISSION_NAME = "SELENE"
^IMAGE = ("tile.img", 1 <BYTES>)
OBJECT = IMAGE
  LINES = {rows}
  LINE_SAMPLES = {columns}
  SAMPLE_TYPE = {type}
  SAMPLE_BITS = {bits}
  UNIT = {unit}
  DUMMY = -9999
END_OBJECT = IMAGE
OBJECT = IMAGE_MAP_PROJECTION
  MAP_PROJECTION_TYPE = "SIMPLE CYLINDRICAL"
  A_AXIS_RADIUS = 1737.400 <km>
  CENTER_LATITUDE = 0 <deg>
  CENTER_LONGITUDE = 0 <deg>
  MAP_RESOLUTION = {ppd} <pixel/deg>
  MAXIMUM_LATITUDE = {north} <deg>
  MINIMUM_LATITUDE = {south} <deg>
  WESTERNMOST_LONGITUDE = {west} <deg>
  EASTERNMOST_LONGITUDE = {east} <deg>
  LINE_PROJECTION_OFFSET = {line_offset} <pixel>
  SAMPLE_PROJECTION_OFFSET = {sample_offset} <pixel>
END_OBJECT = IMAGE_MAP_PROJECTION
END
"""
LOLA = """PDS_VERSION_ID = PDS3
RECORD_BYTES = 16
^IMAGE = {pointer}
INSTRUMENT_ID = "LOLA"
OBJECT = IMAGE
LINES = 4
LINE_SAMPLES = 8
SAMPLE_TYPE = LSB_INTEGER
SAMPLE_BITS = 16
UNIT = KILOMETER
SCALING_FACTOR = 0.0005
OFFSET = 1737.4
MISSING_CONSTANT = -32768
END_OBJECT
OBJECT = IMAGE_MAP_PROJECTION
MAP_PROJECTION_TYPE = SIMPLE_CYLINDRICAL
MAP_SCALE = 1364.555 <KM/PIXEL>
CENTER_LONGITUDE = 180
MAXIMUM_LATITUDE = 90
MINIMUM_LATITUDE = -90
WESTERNMOST_LONGITUDE = 0
EASTERNMOST_LONGITUDE = 360
LINE_PROJECTION_OFFSET = 1.5
SAMPLE_PROJECTION_OFFSET = 3.5
END_OBJECT
END
"""
POLAR = """PDS_VERSION_ID = PDS3
^IMAGE = "TILE.IMG"
OBJECT = IMAGE
LINES = 4
LINE_SAMPLES = 4
SAMPLE_TYPE = PC_REAL
SAMPLE_BITS = 32
MISSING_CONSTANT = 16#FF7FFFFB#
END_OBJECT
OBJECT = IMAGE_MAP_PROJECTION
MAP_PROJECTION_TYPE = "POLAR STEREOGRAPHIC"
CENTER_LATITUDE = {pole}
CENTER_LONGITUDE = 0
MAP_SCALE = 20 <km/pixel>
LINE_PROJECTION_OFFSET = {offset}
SAMPLE_PROJECTION_OFFSET = {offset}
END_OBJECT
END
"""
PADDED = """PDS_VERSION_ID = PDS3
^IMAGE = 41
RECORD_BYTES = 20
OBJECT = IMAGE
LINES = 3
LINE_SAMPLES = 2
SAMPLE_TYPE = IEEE_REAL
SAMPLE_BITS = 64
LINE_PREFIX_BYTES = 2
LINE_SUFFIX_BYTES = 2
INVALID_CONSTANT = (16#FFEFFFFFFFFFFFFF#, -1.5E+3, 'N/A')
END_OBJECT
GROUP = IMAGE_MAP_PROJECTION
MAP_PROJECTION_TYPE = EQUIRECTANGULAR
MAP_RESOLUTION = 16
LINE_PROJECTION_OFFSET = 32
SAMPLE_PROJECTION_OFFSET = -48
NOTE = {"a", b, (c <m>,
 "d")}
LONG = half_-
  other
END_GROUP
END
"""


def kaguya(**changes):
    values = dict(rows=6, columns=6, type="MSB_INTEGER", bits=16, unit='"m"', ppd=16, north=2, west=3, sign=-1)
    values.update(changes)
    v, step = values, 1 / values["ppd"]
    v.setdefault("south", v["north"] - (v["rows"] - 1) * step)
    v.setdefault("east", v["west"] + (v["columns"] - 1) * step)
    v.setdefault("line_offset", v["north"] * v["ppd"])
    v.setdefault("sample_offset", v["sign"] * v["west"] * v["ppd"])
    return KAGUYA.format(**v).replace("\n", "\r\n").encode() + b"\0"


def write_pds():
    posts = [(-1) ** i * 37 * i if i % 7 else -9999 for i in range(36)]
    big = struct.pack(">36h", *posts)
    write("pds_tile", "kaguya.lbl", kaguya() + big)
    write("pds_tile", "kaguya-old-sign.lbl", kaguya(sign=1) + big)
    write("pds_tile", "kaguya-lattice-no.lbl", kaguya(ppd=10) + big)
    write("pds_tile", "kaguya-date-line.lbl", kaguya(west=359.9375) + big)
    write("pds_tile", "kaguya-unsigned.lbl", kaguya(type="LSB_UNSIGNED_INTEGER", bits=32) + struct.pack("<36I", *range(36)))
    write("pds_tile", "kaguya-real.lbl", kaguya(type="PC_REAL", bits=32, unit="N/A") + struct.pack("<36f", *map(float, posts)))
    write("pds_tile", "kaguya-not-finite.lbl", kaguya(type="PC_REAL", bits=32) + struct.pack("<36f", *[float("nan"), float("inf"), 1e30] * 12))
    write("pds_tile", "kaguya-truncated.lbl", kaguya() + big[:-1])
    write("pds_tile", "lola-global.lbl", LOLA.format(pointer='("tile.img", 2)').encode() + b"\0" + struct.pack("<40h", *range(-20, 20)))
    attached = LOLA.format(pointer="700 <BYTES>").encode().ljust(699)
    write("pds_tile", "lola-attached.lbl", attached + struct.pack("<32h", *range(32)))
    for pole, offset in ((90, 2), (-90, -5.5)):
        label = POLAR.format(pole=pole, offset=offset).encode() + b"\0"
        write("pds_tile", f"polar{pole:+}.lbl", label + struct.pack("<16f", *[100.5 * i for i in range(16)]))
    label = PADDED.encode().ljust(800)
    write("pds_tile", "padded.lbl", label + b"".join(b"xx" + struct.pack(">2d", i, -i) + b"yy" for i in range(3)))
    write("pds_tile", "not-a-map.lbl", 'CCSD3ZF PDS_VERSION_ID = PDS3\nOBJECT = IMAGE\nA = "open\nEND')


def write_folders():
    """Tiles that lie in a folder with others: within what a pyramid of a few blocks holds, and what contradicts itself."""
    big = struct.pack(">36h", *[100 * (i % 6) - 7 * i for i in range(36)])
    write("dem_folder", "sound.lbl", kaguya() + big)
    write("dem_folder", "resampled.lbl", kaguya(ppd=10) + big)
    write("dem_folder", "void.lbl", kaguya() + struct.pack(">36h", *[-9999] * 36))
    write("dem_folder", "impossible-heights.lbl", kaguya() + struct.pack(">36h", *[32767] * 36))
    write("dem_folder", "scale.lbl", kaguya().replace(b"DUMMY", b"SCALING_FACTOR = 1e308\r\n  DUMMY") + big)
    write("dem_folder", "offset.lbl", kaguya().replace(b"DUMMY", b"OFFSET = -1e12\r\n  DUMMY") + big)
    write("dem_folder", "radius.lbl", kaguya().replace(b"DUMMY", b"OFFSET = 1737400\r\n  DUMMY") + big)
    write("dem_folder", "corner.lbl", kaguya(line_offset=99) + big)
    write("dem_folder", "date-line.lbl", kaguya(west=359.9375) + big)
    write("dem_folder", "real.lbl", kaguya(type="PC_REAL", bits=32, unit="N/A") + struct.pack("<36f", *[12.5 * i for i in range(36)]))
    write("dem_folder", "kilometres.lbl", kaguya(type="PC_REAL", bits=32, unit="KM") + struct.pack("<36f", *[0.01 * i for i in range(36)]))
    write("dem_folder", "truncated.lbl", kaguya() + big[:40])
    write("dem_folder", "no-image.lbl", kaguya()[:-1])
    write("dem_folder", "no-label.lbl", b"\0" + big)
    write("dem_folder", "another-product.lbl", b"PDS_VERSION_ID = PDS3\nOBJECT = TABLE\nEND_OBJECT\nEND\n\0" + big)


def geotiff(width=6, height=6, tile=(16, 16), step=(0.0625, 0.0625), corner=(12.5, 12), blocks=b"\1\2" * 256, compression=1):
    """Posts in degrees on the Moon's sphere, in tiles that all are `blocks`."""
    keys = [1, 1, 0, 9, 1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 32767, 2050, 0, 1, 32767, 2052, 0, 1, 9001, 2054, 0, 1, 9102,
            2056, 0, 1, 32767, 2057, 34736, 1, 0, 2058, 34736, 1, 1]
    count = -(-width // tile[0]) * -(-height // tile[1])
    tags = [(256, "L", [width]), (257, "L", [height]), (258, "H", [16]), (259, "H", [compression]), (262, "H", [1]), (277, "H", [1]),
            (322, "L", [tile[0]]), (323, "L", [tile[1]]), (324, "L", [0] * count), (325, "L", [len(blocks)] * count), (339, "H", [2]),
            (33550, "d", [*step, 0]), (33922, "d", [0, 0, 0, *corner, 0]), (34735, "H", keys), (34736, "d", [1737400.0, 1737400.0])]
    start = 8 + 2 + 12 * len(tags) + 4
    first = start + sum(len(v) * struct.calcsize("<" + k) for _, k, v in tags if len(v) * struct.calcsize("<" + k) > 4)
    entries = values = b""
    for tag, kind, numbers in tags:
        data = struct.pack(f"<{len(numbers)}{kind}", *([first] * count if tag == 324 else numbers))
        where = data.ljust(4, b"\0") if len(data) <= 4 else struct.pack("<L", start + len(values))
        values += data if len(data) > 4 else b""
        entries += struct.pack("<HHL", tag, {"H": 3, "L": 4, "d": 12}[kind], len(numbers)) + where
    return b"II*\0\x08\0\0\0" + struct.pack("<H", len(tags)) + entries + b"\0\0\0\0" + values + blocks


def vrt(source, transform="12.5, 0.0625, 0, 12, 0, -0.0625"):
    return ('<VRTDataset rasterXSize="6" rasterYSize="6"><SRS>GEOGCS["Moon",DATUM["Moon",SPHEROID["Moon",1737400,0]],'
            f'PRIMEM["0",0],UNIT["degree",0.0174532925199433]]</SRS><GeoTransform>{transform}</GeoTransform>'
            '<VRTRasterBand dataType="Int16" band="1"><SimpleSource><SourceFilename relativeToVRT="1">' + source +
            '</SourceFilename><SourceBand>1</SourceBand><SourceProperties RasterXSize="6" RasterYSize="6" DataType="Int16" '
            'BlockXSize="6" BlockYSize="6"/></SimpleSource></VRTRasterBand></VRTDataset>').encode()


def write_rasters():
    """GeoTIFFs and VRTs: sound, and such as would take all memory or never end."""
    write("dem_folder", "sound.tif", geotiff())
    write("dem_folder", "too-wide.tif", geotiff(width=2, height=2, step=(1e9, 0.25)))
    write("dem_folder", "denormal.tif", geotiff(step=(4.9e-324, 4.9e-324)))
    write("dem_folder", "not-finite.tif", geotiff(corner=(float("nan"), float("inf"))))
    write("dem_folder", "one-huge-tile.tif", geotiff(width=60000, height=60000, tile=(60000, 60000), step=(1e-5, 1e-5), compression=8))
    write("dem_folder", "no-tile.tif", geotiff(tile=(1 << 31, 1 << 31)))
    write("dem_folder", "truncated.tif", geotiff()[:-100])
    write("dem_folder", "nothing.vrt", vrt(""))
    write("dem_folder", "itself.vrt", vrt("tile.vrt"))
    write("dem_folder", "device.vrt", vrt("/dev/zero"))
    write("dem_folder", "not-finite.vrt", vrt("", "nan, inf, 0, -inf, 0, nan"))


# --- pyramid ---------------------------------------------------------------------------------------------------------

STEPS, EMPTY, FROM_SOURCES = 1, 4, 8
UNIFORM = 1 << 30  # of this script: one source in all of the block
HALO, VOID = 2, 65535


def pyramid(row, kinds, names=b"a.lbl\0b.lbl\0"):
    """A file as dem/pyramid/chunk_format.h has it; checksums are left 0: the target makes them right."""
    records = []
    for level, flags in kinds:
        side = (4 << level) + 1
        wide = side + 2 * HALO
        heights = [(7 * i * i) % 301 - (0 if flags & STEPS else 150) for i in range(wide * wide)]
        heights[wide * HALO + HALO] = VOID if flags & STEPS else float("nan")
        runs = [0, side * side] if flags & UNIFORM else [x for i in range(side * side) for x in (i % 2, 1)]
        flags &= ~UNIFORM
        content = struct.pack(f"<{len(heights)}{'H' if flags & STEPS else 'f'}", *heights) + struct.pack(f"<{len(runs)}I", *runs)
        records.append((level, flags, b"" if flags & (EMPTY | FROM_SOURCES) else content))
    index, offset = b"", 64 + 64 * len(records) + len(names)
    for level, flags, content in records:
        index += struct.pack("<iiiIQQQdfffI", level, row, 3, flags, offset, len(content), 0, 12.5, -150, 150, -150, 0)
        offset += len(content)
    header = struct.pack("<8sQQQdiiiiII", b"SGPYRAM2", offset, 12345, 0, 1.0, 4, row, 3, 2, len(records), len(names))
    return header + index + names + b"".join(content for _, _, content in records)


def write_pyramid():
    write("pyramid_file", "equator", pyramid(23, [(0, STEPS), (1, UNIFORM), (2, STEPS | UNIFORM)]))
    write("pyramid_file", "pole", pyramid(0, [(0, 0), (1, STEPS), (2, EMPTY)]))
    write("pyramid_file", "one-name", pyramid(23, [(0, STEPS | UNIFORM)], b"b.lbl\0"))
    write("pyramid_file", "foreign-name", pyramid(23, [(0, STEPS)], b"c.lbl\0"))
    write("pyramid_file", "posts", pyramid(23, [(1, STEPS), (2, FROM_SOURCES)]))
    write("pyramid_file", "nothing", pyramid(23, []))


# --- meshes ----------------------------------------------------------------------------------------------------------

OBJ, PLY, GLTF, GLB = b"\0", b"\1", b"\2", b"\3"
TRIANGLE = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)


def gltf(uri=None):
    buffer = {"byteLength": 36}
    return json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "translation": [10, 0, 0]}, {"mesh": 0, "scale": [2, 2, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}], "materials": [{"name": "foil"}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{**buffer, "uri": uri} if uri else buffer]}).encode()


def write_meshes():
    write("mesh_file", "parts.obj", OBJ + b"mtllib a.mtl\nv 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvn 0 0 1\nusemtl a\n"
          b"f 1//1 2//1 3//1 4//1\nusemtl b\nf 3 2 1\nl 1 2\n")
    write("mesh_file", "latin.obj", OBJ + b"v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl gr\xfcn\nf 1 2 3\n")
    head = (b"ply\nformat %s 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
            b"property list uchar int vertex_indices\nend_header\n")
    write("mesh_file", "ascii.ply", PLY + head % b"ascii" + b"0 0 0\n3 0 0\n0 1 0\n3 0 1 2\n")
    write("mesh_file", "far.ply", PLY + head.replace(b"float", b"double") % b"binary_big_endian"
          + struct.pack(">9d", *(x + 1e6 for x in (0, 0, 0, 3, 0, 0, 0, 1, 0))) + struct.pack(">B3i", 3, 0, 1, 2))
    write("mesh_file", "far.obj", OBJ + b"v 1e6 -1e6 7\nv 1000002 -1e6 7\nv 1000002 -999999 7\nf 1 2 3\n")
    write("mesh_file", "binary.ply", PLY + head % b"binary_little_endian" + TRIANGLE + struct.pack("<B3i", 3, 0, 1, 2))
    write("mesh_file", "inside.gltf", GLTF + gltf("data:application/octet-stream;base64," + base64.b64encode(TRIANGLE).decode()))
    write("mesh_file", "outside.gltf", GLTF + gltf("/etc/hostname"))
    text = gltf()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4e4f534a) + text + struct.pack("<II", len(TRIANGLE), 0x004e4942) + TRIANGLE
    write("mesh_file", "one.glb", GLB + struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    write("mesh_file", "too-long.glb", GLB + struct.pack("<4sIIII", b"glTF", 2, 2 ** 32 - 1, 2 ** 32 - 16, 0x4e4f534a) + b"{}    ")

    corners = b"".join(struct.pack("<6f", *place, *normal) for place, normal in
                       (((0, 0, 0), (0, 0, 0)), ((1, 0, 0), (0, 0, 1)), ((0, 1, 0), (0, 1, 0))))
    triangles = struct.pack("<4I", 0, 1, 2, 1)
    parts = b"".join(struct.pack("<I", len(name)) + name for name in (b"", "gr\u00fcn".encode()))
    whole = struct.pack("<4d2I", 1e6, 2, -3, 0.25, 1, 0)
    shape = struct.pack("<IIII", 0x53474d31, 3, 1, 2) + whole + corners + triangles + parts
    write("mesh_answer", "shape", shape)
    write("mesh_answer", "cut", shape[:-3])
    write("mesh_answer", "index", shape.replace(triangles, struct.pack("<4I", 0, 1, 3, 1)))
    write("mesh_answer", "counts", struct.pack("<IIII", 0x53474d31, 2 ** 32 - 1, 2 ** 32 - 1, 2 ** 32 - 1) + whole + corners)
    write("mesh_answer", "refusal", struct.pack("<I", 0x53474d30) + b"has no triangle")


# --- HTTP ------------------------------------------------------------------------------------------------------------


def write_heads():
    heads = {
        "get": ("GET /v1/height?lat_deg=1&lon_deg=2 HTTP/1.1", "Host: x", "Accept-Encoding: gzip", "Range: bytes=0-1", "Accept:  */* "),
        "post": ("POST /v1/frames HTTP/1.1", "Host: [::1]:8080", "Content-Type: application/json", "Content-Length: 12", "Connection: close"),
        "chunked": ("POST http://h/v1/rays HTTP/1.1", "Host: h", "Transfer-Encoding: chunked", "Content-Encoding: identity"),
        "old": ("GET / HTTP/1.0",),
        "two-lengths": ("POST / HTTP/1.1", "Host: x", "Content-Length: 1", "Transfer-Encoding: chunked"),
        "folded": ("GET / HTTP/1.1", "Host: x", "X: a", " b"),
        "too-long": ("POST / HTTP/1.1", "Host: x", "Content-Length: 99999999999999999999"),
        "noise": ("G@T / HTTP/2.0", "Host : x", "\x01: \n"),
    }
    for name, lines in heads.items():
        write("request_head", name, "\r\n".join(lines))


# The first byte: the size of pieces, less one.
def write_chunks():
    bodies = {
        "plain": "5\r\nhello\r\n0c\r\n, wide world\r\n0\r\n\r\nGET / HTTP/1.1\r\n",
        "extensions": "3;a\r\nabc\r\n2 ; b = c\r\nde\r\n1;d=\"e \\\" f\";g\r\nx\r\n0;h=1\r\n\r\n",
        "trailers": "1\r\nx\r\n0\r\nA: b\r\nContent-Length: 7\r\nEmpty:\r\n\r\nrest",
        "content-is-framing": "7\r\n\r\n0\r\n\r\n\r\n0\r\n\r\n",
        "prefix": "0x5\r\nhello\r\n0\r\n\r\n",
        "sign": "+5\r\nhello\r\n0\r\n\r\n",
        "blank": " 5\r\nhello\r\n0\r\n\r\n",
        "wrap-around": "1\r\nx\r\nffffffffffffffff\r\nx\r\n0\r\n\r\n",
        "seventeen-digits": "10000000000000005\r\nhello\r\n0\r\n\r\n",
        "bare-line-feed": "5\nhello\n0\n\n",
        "behind-the-content": "5\r\nhelloX\r\nGET /metrics HTTP/1.1\r\n\r\n",
        "too-large": "259\r\n" + 601 * "x" + "\r\n0\r\n\r\n",
        "unended": "5;a=b\r\nhel",
        "folded-trailer": "0\r\nA: b\r\n c\r\n\r\n",
    }
    for i, (name, body) in enumerate(bodies.items()):
        write("chunked_body", name, chr(i) + body)


if __name__ == "__main__":
    write_chunks()
    write_json()
    write_pds()
    write_folders()
    write_rasters()
    write_pyramid()
    write_meshes()
    write_heads()
