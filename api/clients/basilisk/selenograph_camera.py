"""A camera of the Basilisk astrodynamics simulation whose images selenograph renders.

    camera = SelenographCamera(selenograph.Client("http://127.0.0.1:8080"), {
        "camera": {"width": 1024, "height": 1024, "fov_deg": 50}, "products": ["image", "range"]})
    camera.sigma_CB = [0.0, 0.0, 0.0]
    camera.scStateInMsg.subscribeTo(spacecraft.scStateOutMsg)
    camera.moonInMsg.subscribeTo(gravFactory.spiceObject.planetStateOutMsgs[moon])
    camera.sunInMsg.subscribeTo(gravFactory.spiceObject.planetStateOutMsgs[sun])
    scSim.AddModelToTask("cameraTask", camera)   # the task's rate is the camera's

Each update reads the spacecraft's state and the states of Moon and Sun, asks for one frame and writes it to imageOutMsg
(Image). The Moon's J20002Pfix must lead to MOON_ME: load NAIF's lunar kernels and give SPICE's planetFrames "MOON_ME";
Basilisk's default, IAU_MOON, is off by up to about 150 m. The camera frame C has OpenCV's axes: +x right in the image,
+y down, +z boresight.

The message is Python's, for Python modules: it holds the array in place of CameraImageMsgPayload's imagePointer, which
can't be set from Python. A frame that the service refuses is a warning, and a message with valid 0: the simulation goes
on. README.md says for which Basilisk this was written and how it is tested. Needs the package selenograph (../python)
and NumPy.
"""

import dataclasses

import numpy as np
import selenograph
from Basilisk.architecture import bskLogging, messaging, sysModel

ASTRONOMICAL_UNIT_M = 149597870700.0


def mrp_matrix(sigma_BN):
    """[BN] of modified Rodrigues parameters, v_B = [BN] v_N (Schaub and Junkins)."""
    s = np.asarray(sigma_BN, float).reshape(3)
    square = s @ s
    tilde = np.array([[0, -s[2], s[1]], [s[2], 0, -s[0]], [-s[1], s[0], 0]])
    return np.eye(3) + (8 * tilde @ tilde - 4 * (1 - square) * tilde) / (1 + square) ** 2


def pose(state, moon, sigma_CB, r_CB_B):
    """A request's "pose" of a SCStatesMsgPayload and the Moon's SpicePlanetStateMsgPayload."""
    BN = mrp_matrix(state.sigma_BN)
    PN = np.asarray(moon.J20002Pfix, float).reshape(3, 3)  # P: MOON_ME
    r_CN_N = np.asarray(state.r_BN_N, float).reshape(3) + BN.T @ np.asarray(r_CB_B, float).reshape(3)
    r_PN_N = np.asarray(moon.PositionVector, float).reshape(3)
    return selenograph.Pose.from_matrix(mrp_matrix(sigma_CB) @ BN @ PN.T, direction="camera_from_moon",
                                        position_m=PN @ (r_CN_N - r_PN_N))


def sun(sun_state, moon):
    """A request's "sun" of the SpicePlanetStateMsgPayloads of Sun and Moon."""
    PN = np.asarray(moon.J20002Pfix, float).reshape(3, 3)
    r_SP_N = np.subtract(np.asarray(sun_state.PositionVector, float), np.asarray(moon.PositionVector, float)).reshape(3)
    distance_m = np.linalg.norm(r_SP_N)
    return {"direction": (PN @ r_SP_N / distance_m).tolist(), "distance_au": distance_m / ASTRONOMICAL_UNIT_M}


@dataclasses.dataclass
class Image:
    """The members of CameraImageMsgPayload, with the array in place of its pointer."""

    timeTag: int = 0  # ns
    valid: int = 0
    cameraID: int = 0
    imageBufferLength: int = 0
    imageType: int = 1  # channels
    image: np.ndarray = None  # digital numbers, height x width
    frame: selenograph.Frame = None  # all products, and metadata


class ImageMsg:
    """A message between Python modules: called, it gives what was written last."""

    def __init__(self):
        self._payload, self._time = Image(), None

    def write(self, payload, CurrentSimNanos, moduleID):
        self._payload, self._time = payload, CurrentSimNanos

    def isWritten(self):
        return self._time is not None

    def timeWritten(self):
        return self._time or 0

    def __call__(self):
        return self._payload


class SelenographCamera(sysModel.SysModel):
    """client: a selenograph.Client. request: a frame's request without "pose", "sun" and "cameras", with the product
    "image"."""

    def __init__(self, client, request):
        super().__init__()
        if "image" not in request.get("products", []):
            raise ValueError('the request\'s "products" must have "image"')
        if "cameras" in request:
            raise ValueError('a request with "cameras" is of several; each is a SelenographCamera of its own')
        self.client, self.request = client, dict(request)
        self.sigma_CB = [0.0, 0.0, 0.0]  # attitude of the camera on the body
        self.r_CB_B = [0.0, 0.0, 0.0]  # m, place of the camera on the body
        self.cameraID = 0
        self.scStateInMsg = messaging.SCStatesMsgReader()
        self.moonInMsg = messaging.SpicePlanetStateMsgReader()
        self.sunInMsg = messaging.SpicePlanetStateMsgReader()
        self.imageOutMsg = ImageMsg()

    def Reset(self, CurrentSimNanos):
        self.imageOutMsg.write(Image(cameraID=self.cameraID), CurrentSimNanos, self.moduleID)
        unlinked = [name for name in ("scStateInMsg", "moonInMsg", "sunInMsg") if not getattr(self, name).isLinked()]
        if unlinked:
            self.bskLogger.bskLog(bskLogging.BSK_ERROR, f"SelenographCamera: not linked: {', '.join(unlinked)}.")

    def UpdateState(self, CurrentSimNanos):
        moon = self.moonInMsg()
        out = Image(timeTag=CurrentSimNanos, cameraID=self.cameraID)
        try:
            out.frame = self.client.frame({**self.request, "sun": sun(self.sunInMsg(), moon),
                                           "pose": pose(self.scStateInMsg(), moon, self.sigma_CB, self.r_CB_B)})
            out.image = out.frame["image"]
            out.imageBufferLength, out.valid = out.image.nbytes, 1
        except (selenograph.Refused, OSError, ValueError, LookupError) as error:
            # The message says that there is no image. BSK_ERROR would end the simulation: Basilisk raises it in Python.
            # bskLog's text is a format of printf.
            self.bskLogger.bskLog(bskLogging.BSK_WARNING, f"SelenographCamera: {error}".replace("%", "%%"))
        self.imageOutMsg.write(out, CurrentSimNanos, self.moduleID)
