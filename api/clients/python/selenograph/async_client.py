"""The client for asyncio."""

from __future__ import annotations

import asyncio
import collections.abc
import concurrent.futures
from typing import Any, AsyncIterable, AsyncIterator, Callable, Dict, Iterable, Optional, Sequence, Union

import numpy as np

from .answers import Answer, Frame, Scan, with_warnings
from .client import Client
from .frame_order import AnswersInOrder, answers_in_order
from .request_types import (AnyFrameRequest, AnyHorizonsRequest, AnyIlluminationRequest, AnyLidarRequest, AnyLight,
                            AnyMapError, AnyMapRequest, AnyRegion, AnySkyRequest, Request)

_END = object()  # stands for the end of an iterable, since coroutines cannot raise StopIteration


class AsyncClient:
    """`Client` for asyncio: the same methods, to be awaited; `frames` is for `async for`.

    Calls run in threads, up to `calls_at_once` of them at a time. Cancelling the wait for a call (by asyncio.wait_for,
    say) does not stop the call: it ends by its timeout_s.
    """

    def __init__(self, url: str, token: Optional[str] = None, timeout_s: float = 60, calls_at_once: int = 8) -> None:
        self._client = Client(url, token, timeout_s)
        self._threads = concurrent.futures.ThreadPoolExecutor(calls_at_once, "selenograph")

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        self._client.close()
        self._threads.shutdown(wait=False)

    async def _run(self, call: Callable[..., Any], *arguments: Any) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._threads, call, *arguments)

    async def frame(self, request: AnyFrameRequest) -> Frame:
        return with_warnings(Frame(await self.encoded(request, "application/x-npz")))

    async def encoded(self, request: Union[AnyFrameRequest, AnyMapRequest], media_type: str = "image/png") -> Answer:
        return await self._run(self._client.encoded, request, media_type)

    async def map(self, request: AnyMapRequest) -> Frame:
        return await self._run(self._client.map, request)

    async def rays(self, origins_m: Any, directions: Any, sun: Optional[Request] = None,
                   objects: Optional[Sequence[Request]] = None, detail: Optional[str] = None,
                   light: Optional[AnyLight] = None, map_error: Optional[AnyMapError] = None) -> np.recarray:
        return await self._run(self._client.rays, origins_m, directions, sun, objects, detail, light, map_error)

    async def project(self, camera: Request, pose: Optional[Request], points: Any, sun: Optional[Request] = None,
                      objects: Optional[Sequence[Request]] = None, shutter: Optional[Request] = None,
                      detail: Optional[str] = None, light: Optional[AnyLight] = None) -> np.recarray:
        return await self._run(self._client.project, camera, pose, points, sun, objects, shutter, detail, light)

    async def horizons(self, request: AnyHorizonsRequest) -> Frame:
        return await self._run(self._client.horizons, request)

    async def illumination(self, request: AnyIlluminationRequest) -> Frame:
        return await self._run(self._client.illumination, request)

    async def lidar(self, request: AnyLidarRequest, directions: Any = None, times_s: Any = None) -> Scan:
        return await self._run(self._client.lidar, request, directions, times_s)

    async def heights(self, lat_deg: Any, lon_deg: Any, detail: Optional[str] = None,
                      map_error: Optional[AnyMapError] = None) -> np.recarray:
        return await self._run(self._client.heights, lat_deg, lon_deg, detail, map_error)

    async def features(self, detail: str, region: AnyRegion, kind: str = "craters", smallest_m: Optional[float] = None,
                       min_depth_over_diameter: Optional[float] = None) -> np.recarray:
        return await self._run(self._client.features, detail, region, kind, smallest_m, min_depth_over_diameter)

    async def sky(self, request: AnySkyRequest) -> np.recarray:
        return await self._run(self._client.sky, request)

    async def limb(self, camera: Request, pose: Request, points: int = 360,
                   detail: Optional[str] = None) -> np.recarray:
        return await self._run(self._client.limb, camera, pose, points, detail)

    async def terminator(self, camera: Request, pose: Request, sun: Request, points: int = 360,
                         detail: Optional[str] = None) -> np.recarray:
        return await self._run(self._client.terminator, camera, pose, sun, points, detail)

    async def datasets(self) -> Dict[str, Any]:
        return await self._run(self._client.datasets)

    async def document(self, path: str, request: Optional[Request] = None) -> Dict[str, Any]:
        return await self._run(self._client.document, path, request)

    def frames(self, requests: Union[Iterable[AnyFrameRequest], AsyncIterable[AnyFrameRequest]], in_flight: int = 2,
               ahead: int = 4) -> AsyncIterator[Frame]:
        """Renders frames as Client.frames does. Requests are taken in the event loop's thread.

        An iterable that waits for something should be an asynchronous one.
        """
        if not isinstance(requests, (collections.abc.Sequence, collections.abc.Mapping)):
            requests = _TakenInLoop(requests, asyncio.get_running_loop())
        return self._frames_of(answers_in_order(requests, in_flight, ahead, self._client._frame_without_warnings))

    async def _frames_of(self, answers: AnswersInOrder) -> AsyncIterator[Frame]:
        # Use a thread of its own: it waits for frames while other calls use the pool.
        waiting = concurrent.futures.ThreadPoolExecutor(1, "selenograph frames")
        try:
            while True:
                frame: Any = await asyncio.get_running_loop().run_in_executor(waiting, next, answers, None)
                if frame is None:
                    return
                yield with_warnings(frame)
        finally:
            answers.stop()
            waiting.shutdown(wait=False)


class _TakenInLoop:
    """An iterable for other threads. Its items are taken in the event loop's thread."""

    def __init__(self, requests: Any, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._iterator = requests.__aiter__() if hasattr(requests, "__aiter__") else iter(requests)

    def __iter__(self) -> _TakenInLoop:
        return self

    def __next__(self) -> Request:
        request = asyncio.run_coroutine_threadsafe(self._take(), self._loop).result()
        if request is _END:
            raise StopIteration
        return request

    async def _take(self) -> Any:
        try:
            return await self._iterator.__anext__() if hasattr(self._iterator, "__anext__") else next(self._iterator)
        except (StopAsyncIteration, StopIteration):
            return _END
