#!/usr/bin/env python3
"""Several clients at once over budgets that hold a fraction of the terrain: every answer is what it is alone, byte for byte.

Blocks, pyramids and acceleration structures come and go all the time here, which is what ThreadSanitizer and AddressSanitizer
should see (ctest --preset tsan -R service.load). Python's standard library only.
"""

import concurrent.futures
import random
import threading
import unittest

import harness
from harness import Service, tearDownModule
from mixture import PLACE, Mixture

CLIENTS = 6
REQUESTS = 40  # different ones; every client sends all of them, in an order of its own
BUDGET_MB = 16  # the least that the service takes, for terrain and as much for acceleration structures
MEBI = 1 << 20


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE)
    harness.assets()


class Load(unittest.TestCase):
    def ask(self, service, connection, request):
        method, path, headers, body = request
        status, answered, content = service.ask(method, path, body, headers, connection)
        return status, answered["Content-Type"], answered["ETag"], content

    def alone(self, requests):
        """One client, budgets for everything."""
        service = Service("--log-level", "warning", "--assets-dir", harness.path("assets"))
        connection = service.connect()
        answers = [self.ask(service, connection, request) for request in requests]
        connection.close()
        self.assertEqual(service.metric("selenograph_terrain_cache_evictions_total"), 0)
        self.assertEqual(service.stop(), 0)
        for request, (status, _, _, content) in zip(requests, answers):
            self.assertEqual(status, 200, (request, content[:300]))
        return answers

    def client(self, service, requests, expected, seed, start):
        """Returns the requests that were answered otherwise."""
        order = list(range(len(requests)))
        random.Random(seed).shuffle(order)
        connection = service.connect()
        start.wait()
        wrong = []
        for i in order:
            answer = self.ask(service, connection, requests[i])
            if answer != expected[i]:
                wrong.append((requests[i], answer[:3], answer[3][:200], expected[i][:3]))
            status, _, content = service.ask("GET", "/metrics", connection=connection)
            if status != 200 or not content.endswith(b"\n"):
                wrong.append(("/metrics", status))
        connection.close()
        return wrong

    def test_answers_are_those_given_alone(self):
        mixture = Mixture(seed=1, maps=False)
        requests = [mixture.next() for _ in range(REQUESTS)]
        expected = self.alone(requests)
        # A cache folder of its own: pyramids are built while several clients wait for the same and for other ones.
        service = Service("--assets-dir", harness.path("assets"), "--cache-mb", str(BUDGET_MB), "--scene-mb", str(BUDGET_MB), "--max-frames", "4", "--log-level", "warning",
                          cache="cache-load")
        start = threading.Barrier(CLIENTS)
        with concurrent.futures.ThreadPoolExecutor(CLIENTS) as pool:
            clients = [pool.submit(self.client, service, requests, expected, seed, start) for seed in range(CLIENTS)]
            wrong = [difference for client in clients for difference in client.result()]
        self.assertEqual(wrong, [])
        evictions = service.metric("selenograph_terrain_cache_evictions_total")
        built = service.metric("selenograph_terrain_chunks_built_total")
        held = service.metric("selenograph_terrain_cache_bytes")
        self.assertEqual(service.metric("selenograph_frames_in_work"), 0)
        self.assertEqual(service.stop(), 0, service.process.returncode)
        print(f"\n  {CLIENTS * REQUESTS} answers, {evictions:.0f} evictions, {built:.0f} chunks built", end=" ", flush=True)
        self.assertGreater(evictions, CLIENTS * REQUESTS, "the budget holds everything: nothing is tested")
        self.assertGreater(built, 0)
        self.assertLessEqual(held, BUDGET_MB * MEBI)


if __name__ == "__main__":
    harness.main()
