#!/usr/bin/env python3
"""A frame by Cycles over the same frame by the service, alternately in one run; in Blender (apt-get install blender):

    SELENOGRAPH_BINARY=build/selenograph blender -b --python tests/benchmark/cycles_benchmark.py [-- FRAMES]

1024 x 1024 pixels, nadir from 30 km over sample terrain, all posts in view as one mesh, a Sun that is a point 15
degrees high, two threads. Cycles: one sample a pixel, direct light alone, the mesh and its BVH kept from frame to
frame. Prints medians, and how well both images agree.
"""

import math
import os
import statistics
import sys
import time

import bpy
import numpy

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "service"))
import harness  # noqa: E402

SIDE, HEIGHT_M, FOV_DEG, SUN_DEG, RADIUS_M = 1024, 30000.0, 50.0, 15.0, 1737400.0
PPD, HALF_DEG = 1024, 0.75  # what is in view, and what shades it


def heights(folder):
    """Four tiles around 0 N 30 E, from the south; their first post is at the north-western corner."""
    def tile(name):
        return numpy.fromfile(os.path.join(folder, f"DTM_MAP_01_{name}SC.img"), ">i2").reshape(PPD, PPD)
    north = numpy.hstack([tile("N01E029N00E030"), tile("N01E030N00E031")])
    south = numpy.hstack([tile("N00E029S01E030"), tile("N00E030S01E031")])
    return numpy.vstack([north, south])[::-1].astype(float)


def ground(folder):
    """Corners (east, north and up of the place on the datum at 0 N 30 E, m), row by row, and how many are in a row."""
    posts = heights(folder)
    index = numpy.arange(2 * PPD)
    lat_deg, lon_deg = (index - (PPD - 1)) / PPD, (index - PPD) / PPD
    rows, columns = abs(lat_deg) <= HALF_DEG, abs(lon_deg) <= HALF_DEG
    lat, lon = numpy.meshgrid(numpy.radians(lat_deg[rows]), numpy.radians(lon_deg[columns]), indexing="ij")
    r = RADIUS_M + posts[rows][:, columns]
    return numpy.stack([r * numpy.cos(lat) * numpy.sin(lon), r * numpy.sin(lat),
                        r * numpy.cos(lat) * numpy.cos(lon) - RADIUS_M], axis=-1).astype("f4"), int(columns.sum())


def mesh_of(corners, across):
    first = numpy.arange(corners.shape[0] * across, dtype="i4").reshape(-1, across)
    quads = numpy.stack([first[:-1, :-1], first[:-1, 1:], first[1:, 1:], first[1:, :-1]], axis=-1).reshape(-1, 4)
    mesh = bpy.data.meshes.new("ground")
    mesh.vertices.add(first.size)
    mesh.vertices.foreach_set("co", corners.ravel())
    mesh.loops.add(quads.size)
    mesh.loops.foreach_set("vertex_index", quads.ravel())
    mesh.polygons.add(len(quads))
    mesh.polygons.foreach_set("loop_start", numpy.arange(0, quads.size, 4, dtype="i4"))
    mesh.polygons.foreach_set("loop_total", numpy.full(len(quads), 4, "i4"))
    mesh.polygons.foreach_set("use_smooth", numpy.ones(len(quads), bool))
    mesh.update(calc_edges=True)
    material = bpy.data.materials.new("grey")
    mesh.materials.append(material)
    return mesh


def scene_of(mesh):
    scene = bpy.context.scene
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle = 3.0, 0.0
    camera = bpy.data.cameras.new("camera")
    camera.angle, camera.clip_end = math.radians(FOV_DEG), 1e6
    parts = {"ground": mesh, "sun": sun, "camera": camera}
    things = {name: bpy.data.objects.new(name, data) for name, data in parts.items()}
    for thing in things.values():
        scene.collection.objects.link(thing)
    things["sun"].rotation_euler = (0, math.radians(90 - SUN_DEG), 0)  # shines along -z; in the east
    things["camera"].location = (0, 0, HEIGHT_M)
    scene.camera, scene.world = things["camera"], None
    render = scene.render
    render.engine, render.use_persistent_data = "CYCLES", True
    render.resolution_x = render.resolution_y = SIDE
    render.threads_mode, render.threads = "FIXED", 2
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    cycles = scene.cycles
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising, cycles.max_bounces = 1, False, False, 0
    cycles.pixel_filter_type, scene.view_settings.view_transform = "BOX", "Raw"
    return scene, things["camera"]


def request():
    asked = harness.frame_request(["radiance"], SIDE, SIDE)
    asked["camera"]["fov_deg"] = FOV_DEG
    asked["pose"]["geodetic"] = {"lat_deg": 0.0, "lon_deg": 30.0, "height_m": HEIGHT_M}
    return asked


def image_by_cycles(scene):
    scene.render.filepath = harness.path("cycles.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    return numpy.array(image.pixels[:], "f4").reshape(SIDE, SIDE, 4)[::-1, :, 0]


def main():
    more = sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else []
    frames = int(more[0]) if more else 20
    harness.set_up()
    try:
        folder = harness.sample("dem", *harness.PLACE, "--columns", "2")
        corners, across = ground(folder)
        scene, camera = scene_of(mesh_of(corners, across))
        service = harness.Service("--threads", "2")
        drawn, rendered = [], []
        for step in range(-3, frames):
            asked = request()
            north_m = 20.0 * max(step, 0)
            asked["pose"]["geodetic"]["lat_deg"] = math.degrees(north_m / RADIUS_M)
            camera.location[1] = north_m
            start = time.perf_counter()
            bpy.ops.render.render()
            rendered.append(time.perf_counter() - start)
            for _ in range(2):  # the first one after Cycles finds cold caches
                start = time.perf_counter()
                answer = service.post("/v1/frames", asked, "application/octet-stream")
                took = time.perf_counter() - start
            drawn.append(took)
            assert answer[0] == 200, answer
        cycles, ours = (1000 * statistics.median(times[3:]) for times in (rendered, drawn))
        camera.location[1] = 0
        by_cycles = image_by_cycles(scene)
        by_us = numpy.frombuffer(service.post("/v1/frames", request(), "application/octet-stream")[2], "<f4")
        shadow = [image.ravel() <= 0 for image in (by_cycles, by_us)]
        service.stop()
    finally:
        harness.tear_down()
    million = 2 * (corners.shape[0] - 1) * (across - 1) / 1e6
    print(f"{million:.1f} million triangles; Cycles {cycles:.0f} ms, ours {ours:.1f} ms, ratio {cycles / ours:.1f}; "
          f"in shadow {100 * shadow[0].mean():.2f} and {100 * shadow[1].mean():.2f} %, "
          f"differently {100 * (shadow[0] != shadow[1]).mean():.2f} %")


main()
