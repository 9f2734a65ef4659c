#!/usr/bin/env python3
"""A spacecraft in a circular orbit 100 km above the Moon whose camera looks straight down; run where Basilisk is.

    build/selenograph serve --dem DIR &
    python3 scenario_lunar_orbit.py --kernels KERNELS [--url http://127.0.0.1:8080] [--minutes 10] [-o OUT]

KERNELS is a folder with NAIF's de430.bsp (or another planetary ephemeris with the Moon), naif0012.tls, pck00010.tpc,
and, for MOON_ME, moon_pa_de421_1900-2050.bpc and moon_080317.tf. Writes a frame a minute to OUT (frame-000.npy, ..) and
prints where it was taken and whether it is sunlit.
"""

import argparse
import pathlib
import sys

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "python")]

import selenograph  # noqa: E402
from Basilisk.simulation import spacecraft  # noqa: E402
from Basilisk.utilities import RigidBodyKinematics, SimulationBaseClass, macros, simIncludeGravBody  # noqa: E402
from selenograph_camera import SelenographCamera  # noqa: E402

EPOCH = "2026 NOVEMBER 20 00:00:00.0 (UTC)"
KERNELS = ["de430.bsp", "naif0012.tls", "pck00010.tpc", "moon_pa_de421_1900-2050.bpc", "moon_080317.tf"]
HEIGHT_M, MOON_RADIUS_M = 100e3, 1737.4e3
REQUEST = {"camera": {"width": 512, "height": 512, "fov_deg": 40}, "products": ["image", "lit"],
           "surface": {"preset": "moon"}}


def orbit(mu):
    """r_BN_N, v_BN_N of a circular orbit over the sunlit side in November 2026, and the body's attitude [BN] and rate
    omega_BN_B, with which the axes of the camera stay those of the orbit: z down, -y along the motion."""
    up = np.array([0.3, -0.9, -0.3])
    up /= np.linalg.norm(up)
    forward = np.array([0.0, 0.0, 1.0]) - up * up[2]
    forward /= np.linalg.norm(forward)
    radius_m = MOON_RADIUS_M + HEIGHT_M
    speed_m_s = np.sqrt(mu / radius_m)
    BN = np.array([np.cross(forward, up), -forward, -up])
    rate_N = np.cross(up, forward) * speed_m_s / radius_m
    return radius_m * up, speed_m_s * forward, BN, BN @ rate_N


def run(client, kernels, minutes, output):
    """Runs the scenario and returns the camera's messages, one a minute."""
    sim = SimulationBaseClass.SimBaseClass()
    process = sim.CreateNewProcess("process")
    process.addTask(sim.CreateNewTask("dynamics", macros.sec2nano(1.0)))
    process.addTask(sim.CreateNewTask("camera", macros.sec2nano(60.0)))

    bodies = simIncludeGravBody.gravBodyFactory()
    moon, _ = bodies.createMoon(), bodies.createSun()
    moon.isCentralBody = True
    # The frames are in the order of the bodies. Basilisk's default for the Moon, IAU_MOON, is off by up to 150 m.
    spice = bodies.createSpiceInterface(path=f"{kernels}/", time=EPOCH, spiceKernelFileNames=KERNELS,
                                        spicePlanetFrames=["MOON_ME", "IAU_SUN"])
    spice.zeroBase = "moon"
    sim.AddModelToTask("dynamics", spice, 10)

    craft = spacecraft.Spacecraft()
    craft.hub.mHub = 500.0
    # With equal moments of inertia a rate stays what it is, so that the camera keeps looking down.
    craft.hub.IHubPntBc_B = [[100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 100.0]]
    r_N, v_N, BN, omega_B = orbit(moon.mu)
    craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = r_N.tolist(), v_N.tolist()
    craft.hub.sigma_BNInit = np.asarray(RigidBodyKinematics.C2MRP(BN)).reshape(3).tolist()
    craft.hub.omega_BN_BInit = omega_B.tolist()
    bodies.addBodiesTo(craft)
    sim.AddModelToTask("dynamics", craft, 5)

    camera = SelenographCamera(client, REQUEST)
    camera.scStateInMsg.subscribeTo(craft.scStateOutMsg)
    camera.moonInMsg.subscribeTo(spice.planetStateOutMsgs[0])
    camera.sunInMsg.subscribeTo(spice.planetStateOutMsgs[1])
    sim.AddModelToTask("camera", camera)

    sim.InitializeSimulation()
    taken = []
    for minute in range(minutes + 1):
        sim.ConfigureStopTime(macros.min2nano(float(minute)))
        sim.ExecuteSimulation()
        taken.append(camera.imageOutMsg())
        report(taken[-1], minute, output)
    return taken


def report(message, minute, output):
    if not message.valid:
        print(f"minute {minute}: no image")
        return
    np.save(output / f"frame-{minute:03}.npy", message.image)
    view = message.frame.meta["view"]
    if view["lat_deg"] is None:
        print(f"minute {minute}: off the terrain")
        return
    print(f"minute {minute}: latitude {view['lat_deg']:.3f}, longitude {view['lon_deg']:.3f}, "
          f"{100 * np.nanmean(message.frame['lit']):.0f} % sunlit")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kernels", required=True)
    parser.add_argument("--url", default="http://127.0.0.1:8080")
    parser.add_argument("--minutes", type=int, default=10)
    parser.add_argument("-o", "--output", type=pathlib.Path, default=pathlib.Path("."))
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    with selenograph.Client(options.url) as client:
        run(client, options.kernels, options.minutes, options.output)


if __name__ == "__main__":
    main()
