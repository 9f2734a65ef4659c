"""deploy/operation/team with the real HAProxy: tokens, limits, slow clients, what stays inside, affinity, and nodes that
are killed and restarted under load. Needs haproxy, openssl and curl (deploy/install-packages team); skipped without.
"""

import collections
import concurrent.futures
import contextlib
import hashlib
import http.client
import json
import os
import re
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
import unittest
import unittest.mock
import urllib.request

import harness
import monitoring_test
from harness import BINARY, PATIENCE_S, REPOSITORY, frame_request

sys.path.insert(0, os.path.join(REPOSITORY, "api", "clients", "python"))

AT_ONCE, RATE, RECEIVE_S = 8, 1500, 2
KILLS = int(os.environ.get("TEAM_KILLS", "3"))
TOKEN = os.path.join(REPOSITORY, "deploy", "operation", "haproxy", "token")
MISSING = [tool for tool in ("haproxy", "openssl", "curl") if not shutil.which(tool, path=os.environ["PATH"] + ":/usr/sbin")]

team = None


def setUpModule():
    global team
    if MISSING:
        raise unittest.SkipTest(f"{' and '.join(MISSING)} not found: deploy/install-packages team")
    harness.set_up()
    harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns", "2", "--ppd", "256")
    team = Team()


def tearDownModule():
    if team:
        team.stop()
    harness.tear_down()


class Team:
    def __init__(self, name="team", receive_s=RECEIVE_S):
        self.folder = harness.path(name)
        command = [os.path.join(REPOSITORY, "deploy", "operation", "team"), "--dir", self.folder, "--port", "0",
                   "--inside-port", "0",
                   "--binary", BINARY, "--dem", harness.path("dem"), "--", "--cache-mb", "64", "--scene-mb", "64", "--mesh-mb",
                   "16", "--memory-mb", "1000", "--max-frames", "1", "--max-waiting", "12"]
        environment = {**os.environ, "SELENOGRAPH_TOKEN_AT_ONCE": str(AT_ONCE), "SELENOGRAPH_TOKEN_RATE": str(RATE),
                       "SELENOGRAPH_RECEIVE_TIMEOUT": f"{receive_s}s"}
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        said = ""
        for line in self.process.stdout:
            said += line
            if "team: ready" in line:
                break
        else:
            raise RuntimeError(f"deploy/operation/team did not start: {said}{self.logs()}")
        self.port = int(re.search(r"ready on https://localhost:(\d+)", said)[1])
        self.inside = re.search(r"inside (http://[^/]+)", said)[1]
        self.nodes = re.findall(r"(http://[^/]+)/metrics", re.search(r"inside \S+ and (.*)", said)[1])
        self.first = re.search(r"token (\S+)", said)[1]
        self.tls = ssl.create_default_context(cafile=os.path.join(self.folder, "public.pem"))
        self.said = []
        threading.Thread(target=lambda: self.said.extend(self.process.stdout), daemon=True).start()

    def client(self, token):
        """api/clients/python."""
        import selenograph
        with unittest.mock.patch.dict(os.environ, {"SSL_CERT_FILE": os.path.join(self.folder, "public.pem")}):
            return selenograph.Client(f"https://localhost:{self.port}", token)

    def logs(self):
        text = ""
        for name in sorted(os.listdir(self.folder)) if os.path.isdir(self.folder) else ():
            if name.endswith(".log"):
                text += f"\n{name}: {self.log(name)[-2000:]}"
        return text

    def log(self, name):
        with open(os.path.join(self.folder, name), errors="replace") as file:
            return file.read()

    def lines(self, name):
        """Of an access log: JSON lines with a request id."""
        lines = [json.loads(line) for line in self.log(name).splitlines() if line.startswith("{")]
        return [line for line in lines if "request_id" in line]

    def pid(self, name):
        with open(os.path.join(self.folder, name + ".pid")) as file:
            return int(file.read())

    def token(self, *arguments, folder=None):
        return subprocess.run([sys.executable, TOKEN, *arguments, "--dir", folder or self.folder, "--socket",
                               os.path.join(self.folder, "haproxy.sock")], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              text=True, timeout=PATIENCE_S)

    def new_token(self, name):
        made = self.token("add", name)
        assert made.returncode == 0 and not made.stderr, made
        return made.stdout.strip()

    def connect(self):
        return http.client.HTTPSConnection("localhost", self.port, timeout=PATIENCE_S, context=self.tls)

    def ask(self, method, path, token=None, body=None, connection=None, **headers):
        """(status, headers, body), asked once."""
        sent = {name.replace("_", "-"): value for name, value in headers.items()}
        if token:
            sent["Authorization"] = f"Bearer {token}"
        if body is not None:
            sent["Content-Type"] = "application/json"
        with contextlib.ExitStack() as opened:
            if connection is None:
                connection = opened.enter_context(contextlib.closing(self.connect()))
            connection.request(method, path, body, sent)
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()

    def frame(self, request, token, connection=None, **headers):
        return self.ask("POST", "/v1/frames", token, json.dumps(request).encode(), connection, Accept="application/x-npy",
                        **headers)

    def proxy_metric(self, name):
        with urllib.request.urlopen(self.inside + "/metrics", timeout=PATIENCE_S) as answer:
            values = re.findall(r"^" + name + r'\{proxy="nodes"[^}]*\} (\S+)$', answer.read().decode(), re.M)
        return sum(map(float, values))

    def in_work(self):
        """Frames in work on both nodes."""
        count = 0
        for node in self.nodes:
            with urllib.request.urlopen(node + "/metrics", timeout=PATIENCE_S) as answer:
                count += int(re.search(r"^selenograph_frames_in_work (\d+)$", answer.read().decode(), re.M)[1])
        return count

    def wait_until(self, true, what):
        harness.wait_until(true, lambda: what + self.logs())

    def stop(self):
        self.process.terminate()
        self.process.wait(PATIENCE_S)


def view(degrees=0.0, width=64, samples=1):
    """Frames over the sample terrain; another longitude, another frame."""
    return frame_request(width=width, height=width, samples=samples,
                         pose={"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1 + degrees, "height_m": 20000.0},
                               "nadir": {"up_azimuth_deg": 0.0}})


class Load:
    """Frames asked for by several threads until stop(), each request once: nothing hides a failed answer."""

    def __init__(self, token, threads=4):
        self.token, self.threads = token, threads
        # Much work for an answer that fits into one packet train: a node is killed before it or after it.
        self.requests = [view(0.02 * i, width=64, samples=64) for i in range(6)]
        self.expected = [team.frame(request, token)[2] for request in self.requests]
        self.answers, self.faults, self.worst_s = 0, [], 0.0
        self.ending = threading.Event()
        self.pool = concurrent.futures.ThreadPoolExecutor(threads)

    def __enter__(self):
        self.running = [self.pool.submit(self.ask, i) for i in range(self.threads)]
        return self

    def ask(self, number):
        connection = None
        while not self.ending.is_set():
            number += 1
            k = number % len(self.requests)
            # Half of the regions' hashes belong to each node, or so.
            headers = {"Selenograph_Region": f"{number % 16}-1"}
            connection = connection or team.connect()
            start = time.monotonic()
            try:
                status, answered, body = team.frame(self.requests[k], self.token, connection, **headers)
                if status != 200 or body != self.expected[k]:
                    self.faults.append((status, body[:300], dict(answered)))
                if answered.get("Connection") == "close":
                    connection = connection.close()
            except Exception as error:  # a thread's own exception would be seen too late
                self.faults.append(repr(error))
                connection = connection.close()
            self.answers += 1
            self.worst_s = max(self.worst_s, time.monotonic() - start)
        if connection:
            connection.close()

    def go_on(self, answers):
        """Until so many more have come."""
        before = self.answers
        team.wait_until(lambda: self.answers >= before + answers or self.faults, f"{answers} answers")

    def __exit__(self, *_):
        self.ending.set()
        concurrent.futures.wait(self.running)
        self.pool.shutdown()
        print(f"\n  {self.answers} answers, {len(self.faults)} failed, the slowest after {self.worst_s:.1f} s ", end="")


class Tokens(unittest.TestCase):
    def refused(self, answer):
        status, headers, body = answer
        self.assertEqual(status, 401, body)
        self.assertEqual(headers["Content-Type"], "application/problem+json")
        self.assertIn("Bearer", headers["WWW-Authenticate"])
        self.assertTrue(headers["X-Request-Id"])
        self.assertEqual(json.loads(body)["status"], 401)

    def test_missing_and_wrong_tokens_are_refused(self):
        asked = len(team.lines("node1.log") + team.lines("node2.log"))
        digest = hashlib.sha256(team.first.encode()).hexdigest()
        for header in (None, "", "Bearer", "Bearer ", "Bearer wrong", f"Basic {team.first}", team.first, f"Bearer {digest}",
                       f"Bearer {team.first}x", f"Bearer {team.first[:-1]}", f"Bearer {team.first.swapcase()}",
                       "Bearer " + "x" * 4000):
            with self.subTest(header=header):
                self.refused(team.ask("GET", "/v1/datasets", **({} if header is None else {"Authorization": header})))
        self.assertEqual(len(team.lines("node1.log") + team.lines("node2.log")), asked, "a node was asked")
        self.assertEqual(team.ask("GET", "/v1/datasets", team.first)[0], 200)

    def test_a_revoked_token_is_refused_on_connections_that_are_open_too(self):
        token = team.new_token("leaving")
        self.assertIn("there is a token leaving already", team.token("add", "leaving").stderr)
        with contextlib.closing(team.connect()) as connection:
            self.assertEqual(team.ask("GET", "/v1/datasets", token, connection=connection)[0], 200)
            self.assertEqual(team.token("revoke", "leaving").stderr, "")
            self.refused(team.ask("GET", "/v1/datasets", token, connection=connection))
        self.refused(team.ask("GET", "/v1/datasets", token))
        self.assertEqual(team.ask("GET", "/v1/datasets", team.first)[0], 200)
        self.assertIn("there is no token leaving", team.token("revoke", "leaving").stderr)
        self.assertNotIn("leaving", team.token("list").stdout)
        self.assertIn("a name has up to 64", team.token("add", "two words").stderr)

    def test_other_lines_of_the_file_stay(self):
        folder = harness.path("tokens by hand")
        self.assertIn("reload it if it runs", self.alone("add", "one", folder)[1])
        path = os.path.join(folder, "tokens")
        with open(path) as file:
            one = file.read()
        by_hand = f"# flight team\n\n{one}# others"  # without a line's end
        with open(path, "w") as file:
            file.write(by_hand)
        self.alone("add", "two", folder)
        self.assertEqual(self.alone("list", None, folder)[0].split()[::2], ["one", "two"])
        self.alone("revoke", "two", folder)
        with open(path) as file:
            self.assertEqual(file.read(), by_hand + "\n")

    def alone(self, command, name, folder, path="none.sock", status=0):
        done = subprocess.run([sys.executable, TOKEN, command, *([name] if name else []), "--dir", folder, "--socket", path],
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S)
        self.assertEqual(done.returncode, status, done.stderr)
        return done.stdout, done.stderr

    def test_edited_by_hand_and_reloaded_while_others_go_on(self):
        token, busy = team.new_token("by-hand"), team.new_token("busy")
        path = os.path.join(team.folder, "tokens")
        with Load(busy) as load:
            load.go_on(10)
            with open(path) as file:
                kept = [line for line in file if not line.endswith(" by-hand\n")]
            with open(path, "w") as file:
                file.writelines(kept)
            os.kill(team.pid("haproxy"), signal.SIGUSR2)
            team.wait_until(lambda: team.ask("GET", "/v1/datasets", token)[0] == 401, "the reload")
            load.go_on(20)
        self.assertEqual(load.faults, [])

    def test_a_node_learns_the_name_and_not_the_token(self):
        token = team.new_token("secretive")
        self.assertEqual(team.frame(view(), token, X_Request_Id="who-asks", Selenograph_Token="somebody-else")[0], 200)
        [line] = [line for node in ("node1.log", "node2.log") for line in team.lines(node) if line["request_id"] == "who-asks"]
        self.assertEqual(line["token"], "secretive")
        [line] = [line for line in team.lines("haproxy.log") if line["request_id"] == "who-asks"]
        self.assertEqual((line["token"], line["status"]), ("secretive", 200))
        self.assertNotIn(token, team.logs())
        with open(os.path.join(team.folder, "tokens")) as file:
            self.assertNotIn(token, file.read())


class Failures(unittest.TestCase):
    """Of deploy/operation/team itself, in a temporary folder of its own."""

    def run_team(self, *options):
        os.makedirs(harness.path("temporary"), exist_ok=True)
        done = subprocess.run([os.path.join(REPOSITORY, "deploy", "operation", "team"), "--binary", BINARY, "--inside-port", "0",
                               *options], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=PATIENCE_S,
                              env={**os.environ, "TMPDIR": harness.path("temporary")})
        self.assertNotEqual(done.returncode, 0, done.stdout)
        self.assertNotIn("Traceback", done.stdout)
        return done.stdout

    def test_the_log_that_it_names_is_there(self):
        said = self.run_team("--port", "0", "--dem", harness.path("dem"), "--", "--nonsense")
        with open(re.search(r"node1 did not start: see (\S+)", said)[1]) as file:
            self.assertIn("--nonsense", file.read())
        with socket.create_server(("127.0.0.1", 0)) as other:
            taken = str(other.getsockname()[1])
            self.assertIn(f"127.0.0.1:{taken} is not available", self.run_team("--port", taken, "--dem", harness.path("dem")))

    def test_a_second_team_in_a_folder_or_at_a_port_is_refused(self):
        # HAProxy shares its ports: a token that one of two revokes would still be good for the other.
        self.assertIn("another team runs in", self.run_team("--dir", team.folder, "--port", "0"))
        self.assertIn("is not available: Address already in use", self.run_team("--port", str(team.port)))


class Names(unittest.TestCase):
    def ask(self, host):
        with contextlib.closing(team.connect()) as connection:
            connection.request("GET", "/v1/datasets", headers={"Authorization": f"Bearer {team.first}", "Host": host})
            answer = connection.getresponse()
            return answer.status, json.loads(answer.read())

    def test_the_proxys_own_alone(self):
        for host in ("localhost", f"localhost:{team.port}", "LOCALHOST", f"127.0.0.1:{team.port}", "[::1]:1"):
            self.assertEqual(self.ask(host)[0], 200, host)
        for host in ("evil.example", f"evil.example:{team.port}", "localhost.evil.example"):
            status, problem = self.ask(host)
            self.assertEqual((status, problem["type"]), (421, "urn:selenograph:problem:misdirected_request"), host)


class Network(unittest.TestCase):
    def test_plain_http_gets_nothing(self):
        with socket.create_connection(("localhost", team.port), timeout=PATIENCE_S) as s:
            s.sendall(f"GET /v1/datasets HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {team.first}\r\n\r\n".encode())
            received = b""
            with contextlib.suppress(ConnectionResetError):
                while piece := s.recv(4096):
                    received += piece
        self.assertNotIn(b"HTTP/1.1 2", received)
        self.assertNotIn(b"datasets", received)

    def test_an_old_tls_is_refused(self):
        old = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        old.check_hostname, old.verify_mode = False, ssl.CERT_NONE
        old.set_ciphers("ALL:@SECLEVEL=0")
        old.minimum_version, old.maximum_version = ssl.TLSVersion.TLSv1, ssl.TLSVersion.TLSv1_1
        with socket.create_connection(("localhost", team.port), timeout=PATIENCE_S) as s:
            with self.assertRaises((ssl.SSLError, ConnectionError)):
                old.wrap_socket(s)

    def dribble(self, head, pieces):
        """Sends pieces slowly until there is an answer, or the proxy closes."""
        with socket.create_connection(("localhost", team.port), timeout=PATIENCE_S) as plain:
            with team.tls.wrap_socket(plain, server_hostname="localhost") as s:
                s.sendall(head)
                s.settimeout(0.1)
                received = b""
                for _ in range(int(PATIENCE_S / 0.1)):
                    try:
                        s.sendall(pieces)
                        piece = s.recv(4096)
                        received += piece
                        if not piece or b"\r\n\r\n" in received:
                            return received
                    except socket.timeout:
                        continue
                    except OSError:
                        return received
        self.fail("the proxy waits for ever")

    def test_slow_clients_are_given_up_and_hold_no_place(self):
        line = f"POST /v1/frames HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {team.first}\r\n".encode()
        asked = len(team.lines("node1.log") + team.lines("node2.log"))
        self.assertIn(b"HTTP/1.1 408 ", self.dribble(line, b"X"))  # HAProxy's own: it knows nothing of the request yet
        body = b"Content-Type: application/json\r\nContent-Length: 4000\r\n\r\n{"
        answer = self.dribble(line + body, b" ")
        self.assertIn(b"HTTP/1.1 408 ", answer)
        self.assertRegex(answer.lower(), rb"\r\nx-request-id: [0-9a-f-]{36}\r\n")
        self.assertIn(b"urn:selenograph:problem:request_timeout", answer)
        self.assertEqual(len(team.lines("node1.log") + team.lines("node2.log")), asked, "a node was asked")
        # Without a token there is no waiting for a body.
        nobody = line.replace(team.first.encode(), b"wrong")
        self.assertIn(b"HTTP/1.1 401 ", self.dribble(nobody + body, b""))

    # What could make two readers see different requests: after the head's first lines, a body, and a request behind it.
    MALFORMED = {
        "two lengths": b"Content-Length: %(size)d\r\nContent-Length: 3\r\n\r\n%(body)b",
        "a list of lengths": b"Content-Length: %(size)d, 3\r\n\r\n%(body)b",
        "a signed length": b"Content-Length: +%(size)d\r\n\r\n%(body)b",
        "a negative length": b"Content-Length: -1\r\n\r\n%(body)b",
        "a hexadecimal length": b"Content-Length: 0x2f\r\n\r\n%(body)b",
        "a length with a letter": b"Content-Length: %(size)da\r\n\r\n%(body)b",
        "an empty length": b"Content-Length: \r\n\r\n%(body)b",
        "a length over 64 bits": b"Content-Length: 18446744073709551663\r\n\r\n%(body)b",
        "a blank before a colon": b"Content-Length : %(size)d\r\n\r\n%(body)b",
        "a line without a colon": b"Content-Length: %(size)d\r\nnonsense\r\n\r\n%(body)b",
        "a carriage return in a line": b"Content-Length: %(size)d\r\nX: a\rb\r\n\r\n%(body)b",
        "two hosts": b"Content-Length: %(size)d\r\nHost: evil.example\r\n\r\n%(body)b",
        "another coding": b"Transfer-Encoding: gzip\r\n\r\n%(chunks)b",
        "chunked twice": b"Transfer-Encoding: chunked, chunked\r\n\r\n%(chunks)b",
        "nearly chunked": b"Transfer-Encoding: xchunked\r\n\r\n%(chunks)b",
        "two codings": b"Transfer-Encoding: chunked\r\nTransfer-Encoding: identity\r\n\r\n%(chunks)b",
        "a blank after the coding's name": b"Transfer-Encoding : chunked\r\n\r\n%(chunks)b",
        "a chunk without a size": b"Transfer-Encoding: chunked\r\n\r\nzz\r\n%(body)b\r\n0\r\n\r\n",
        "a negative chunk": b"Transfer-Encoding: chunked\r\n\r\n-1\r\n%(body)b\r\n0\r\n\r\n",
        "a chunk of 0x2f bytes": b"Transfer-Encoding: chunked\r\n\r\n0x2f\r\n%(body)b\r\n0\r\n\r\n",
        "a chunk over 64 bits": b"Transfer-Encoding: chunked\r\n\r\n1000000000000002f\r\n%(body)b\r\n0\r\n\r\n",
        "a chunk without an end": b"Transfer-Encoding: chunked\r\n\r\n2f\r\n%(body)b0\r\n\r\n",
    }

    def test_malformed_requests_reach_no_node(self):
        """cpp-httplib takes some of these forms: the proxy refuses them, with the request behind each."""
        body = json.dumps({"points": [{"lat_deg": 0.1, "lon_deg": 30.1}]}).encode()
        values = {b"size": len(body), b"body": body, b"chunks": b"%x\r\n%b\r\n0\r\n\r\n" % (len(body), body)}
        token = f"Host: localhost\r\nAuthorization: Bearer {team.first}\r\n".encode()
        behind = b"GET /v1/datasets HTTP/1.1\r\n" + token + b"X-Request-Id: smuggled\r\nConnection: close\r\n\r\n"

        def ask(rest):
            with socket.create_connection(("localhost", team.port), timeout=PATIENCE_S) as plain:
                with team.tls.wrap_socket(plain, server_hostname="localhost") as s:
                    s.sendall(b"POST /v1/heights HTTP/1.1\r\n" + token + b"Content-Type: application/json\r\n"
                              b"X-Request-Id: malformed\r\n" + rest % values + behind)
                    answer = b""
                    with contextlib.suppress(ConnectionError, ssl.SSLError):
                        while got := s.recv(65536):
                            answer += got
                    return [int(status) for status in re.findall(rb"HTTP/1\.1 (\d{3}) ", answer)]

        self.assertEqual(ask(b"Content-Length: %(size)d\r\n\r\n%(body)b"), [200, 200])
        self.assertEqual(ask(b"Transfer-Encoding: chunked\r\n\r\n%(chunks)b"), [200, 200])

        def seen():
            return [line["request_id"] for node in ("node1.log", "node2.log") for line in team.lines(node)]

        team.wait_until(lambda: seen().count("malformed") == 2 and seen().count("smuggled") == 2, "the well-formed ones")
        for name, rest in self.MALFORMED.items():
            with self.subTest(name):
                self.assertEqual(ask(rest), [400])
        self.assertEqual(team.ask("GET", "/v1/datasets", team.first, X_Request_Id="after")[0], 200)
        team.wait_until(lambda: "after" in seen(), "the line of a later request")
        self.assertEqual((seen().count("malformed"), seen().count("smuggled")), (2, 2), "a node was asked")

    def test_what_stays_inside(self):
        for path in ("/metrics", "/health/live", "/health/ready", "/", "/docs", "/v1", "//metrics", "/v1/../metrics",
                     "/v1/%2e%2e/metrics", "/v1/..%2fmetrics", "/%6detrics", "/metrics/", "/openapi.json/../metrics"):
            with self.subTest(path=path):
                status, headers, body = team.ask("GET", path, team.first)
                self.assertEqual(status, 404, body)
                self.assertNotIn(b"selenograph_", body)
        self.assertEqual(team.ask("GET", "/openapi.json", team.first)[0], 200)
        with urllib.request.urlopen(team.inside + "/health", timeout=PATIENCE_S) as answer:
            self.assertEqual(answer.status, 200)
        self.assertEqual(team.proxy_metric("haproxy_backend_active_servers"), 2)


class Leaving(unittest.TestCase):
    def curl(self, version, request, request_id):
        headers = (f"Authorization: Bearer {team.first}", "Content-Type: application/json", f"X-Request-Id: {request_id}")
        return subprocess.Popen(
            ["curl", "--silent", version, "--cacert", os.path.join(team.folder, "public.pem"),
             *(word for header in headers for word in ("--header", header)), "--data", json.dumps(request),
             "--output", os.devnull, "--write-out", "%{http_version} %{http_code}", f"https://localhost:{team.port}/v1/frames"],
            stdout=subprocess.PIPE, text=True)

    def ends_of(self, request_id):
        """The errors in the nodes' logs of a request."""
        return [line["error"] for node in ("node1.log", "node2.log") for line in team.lines(node)
                if line["request_id"] == request_id]

    def test_a_client_that_closes_its_connection_cancels_its_work(self):
        for version, spoken in (("--http1.1", "1.1"), ("--http2", "2")):
            with self.subTest(version=version):
                self.assertEqual(self.curl(version, view(), "stays").communicate(timeout=PATIENCE_S)[0], spoken + " 200")
                leaving = "leaves-" + spoken
                client = self.curl(version, view(width=1024, samples=100), leaving)  # many seconds of work
                team.wait_until(lambda: team.in_work() == 1, "a frame in work")
                client.kill()
                closed = time.monotonic()
                client.communicate()
                team.wait_until(lambda: self.ends_of(leaving), "the end of its work")
                print(f"\n  HTTP/{spoken}: cancelled after {time.monotonic() - closed:.2f} s ", end="")
                self.assertEqual(self.ends_of(leaving), ["client_gone"])  # none, had it been finished


class Silence(unittest.TestCase):
    def test_silent_connections_of_one_address_keep_no_other_out(self):
        """More than the proxy holds, and none of them is given up within the test's patience."""
        patient = Team("patient", receive_s=10 * PATIENCE_S)
        held, refused = 0, 0
        try:
            with contextlib.ExitStack() as opened:
                while held + refused < 2250:
                    try:
                        silent = opened.enter_context(
                            socket.create_connection(("127.0.0.1", patient.port), PATIENCE_S, ("127.0.0.2", 0)))
                        if not refused:  # behind the handshake a connection is silent for longest
                            opened.enter_context(patient.tls.wrap_socket(silent, server_hostname="localhost"))
                            held += 1
                            continue
                    except (ssl.SSLError, ConnectionError):
                        pass
                    refused += 1
                self.assertGreater(held, 100)
                start = time.monotonic()
                self.assertEqual(patient.frame(view(), patient.first)[0], 200)
                print(f"\n  {held} silent connections, another address answered after {time.monotonic() - start:.2f} s ", end="")
        finally:
            patient.stop()


class Monitoring(unittest.TestCase):
    def test_the_proxy_has_what_dashboard_and_alerts_name(self):
        with urllib.request.urlopen(team.inside + "/metrics", timeout=PATIENCE_S) as answer:
            there = monitoring_test.samples(answer.read().decode())
        expressions = monitoring_test.dashboard_expressions() + monitoring_test.alert_expressions()
        self.assertGreater(sum("haproxy_" in expression for expression in expressions), 10)
        self.assertEqual(monitoring_test.missing(expressions, there, "haproxy_"), [])


class Limits(unittest.TestCase):
    def test_one_over_its_limit_is_told_and_another_goes_on(self):
        greedy, other = team.new_token("greedy"), team.new_token("other")
        expected = team.frame(view(), other)[2]
        statuses = collections.Counter()
        ending = threading.Event()

        def want_more():
            while not ending.is_set():
                status, headers, body = team.frame(view(0.05, width=256, samples=4), greedy)
                statuses[status] += 1
                if status in (429, 503):
                    assert int(headers["Retry-After"]) > 0, headers
                    assert json.loads(body)["status"] == status, body

        with concurrent.futures.ThreadPoolExecutor(2 * AT_ONCE) as pool:
            running = [pool.submit(want_more) for _ in range(2 * AT_ONCE)]
            try:
                team.wait_until(lambda: statuses[429] > 0, "429")
                for _ in range(10):
                    status, _, body = team.frame(view(), other)
                    self.assertEqual((status, body), (200, expected))
            finally:
                ending.set()
            for done in running:
                done.result()
        self.assertGreater(statuses[200], 0)
        self.assertLessEqual(set(statuses), {200, 429, 503}, statuses)

    def test_requests_in_ten_seconds(self):
        token = team.new_token("hasty")
        statuses = collections.Counter()
        with contextlib.closing(team.connect()) as connection:
            while statuses[429] == 0 and statuses[404] < 20 * RATE:
                status, headers, _ = team.ask("GET", "/nothing", token, connection=connection)
                statuses[status] += 1
        self.assertEqual(int(headers["Retry-After"]), 5)
        self.assertGreaterEqual(statuses[404], RATE)
        self.assertEqual(team.ask("GET", "/v1/datasets", team.first)[0], 200)

    def test_a_full_queue_is_503(self):
        """Two nodes of one place and twelve waiting; four tokens ask for more."""
        tokens = [team.new_token(f"one-of-{i}") for i in range(4)]
        request = view(0.1, width=1024, samples=4)  # takes longer than all of them to ask
        with concurrent.futures.ThreadPoolExecutor(4 * AT_ONCE) as pool:
            answers = list(pool.map(lambda i: team.frame(request, tokens[i % 4]), range(4 * AT_ONCE)))
        statuses = collections.Counter(status for status, _, _ in answers)
        self.assertEqual(set(statuses), {200, 503}, statuses)
        for status, headers, body in answers:
            if status == 503:
                self.assertGreater(int(headers["Retry-After"]), 0)
                self.assertEqual(json.loads(body)["type"], "urn:selenograph:problem:busy")


class Nodes(unittest.TestCase):
    def nodes_of(self, token, answers):
        """Which node answered, by request id, once so many answers are in the log, which is written after them."""
        def nodes():
            return {line["request_id"]: line["node"] for line in team.lines("haproxy.log") if line["token"] == token}

        team.wait_until(lambda: len(nodes()) >= answers, f"{answers} answers of {token} in the log")
        return nodes()

    def test_a_region_has_a_node(self):
        with team.client(team.new_token("flying")) as client:
            for i in range(12):  # one cell
                client.frame(view(0.05 * i))
            client.project(view()["camera"], view()["pose"], [(0, 30)])
        one_cell = list(self.nodes_of("flying", 13).values())
        self.assertEqual(len(one_cell), 13)
        self.assertEqual(len(set(one_cell)), 1, one_cell)
        regions = team.new_token("everywhere")
        for _ in range(2):
            for i in range(12):
                team.frame(view(), regions, Selenograph_Region=f"{i}-7", X_Request_Id=f"r{i}-{_}")
        nodes = self.nodes_of("everywhere", 24)
        self.assertEqual([nodes[f"r{i}-0"] for i in range(12)], [nodes[f"r{i}-1"] for i in range(12)])
        self.assertEqual(set(nodes.values()), {"node1", "node2"})

    def test_a_killed_node_costs_no_answer(self):
        token = team.new_token("through-death")
        retries = team.proxy_metric("haproxy_backend_retry_warnings_total")
        ending = threading.Event()

        def large_answers():
            """A node may die while one of them is on its way; the client library asks again."""
            with team.client(token) as client:
                request, count = view(width=512), 0
                expected = client.frame(request)["radiance"].tobytes()
                while not ending.is_set():
                    self.assertEqual(client.frame(request)["radiance"].tobytes(), expected)
                    count += 1
                return count

        with Load(token) as load, concurrent.futures.ThreadPoolExecutor(1) as pool:
            large = pool.submit(large_answers)
            try:
                for i in range(KILLS):
                    name = f"node{i % 2 + 1}"
                    load.go_on(15)
                    pid = team.pid(name)
                    os.kill(pid, signal.SIGKILL)
                    load.go_on(15)
                    team.wait_until(lambda: team.pid(name) != pid and
                                    team.proxy_metric("haproxy_backend_active_servers") == 2, f"{name} again")
            finally:
                ending.set()
            self.assertGreater(large.result(PATIENCE_S), 10)
        self.assertEqual(load.faults, [])
        retries = team.proxy_metric("haproxy_backend_retry_warnings_total") - retries
        print(f"{retries:.0f} sent again ", end="")
        self.assertGreater(retries, 0)

    def test_a_rolling_restart_costs_no_answer(self):
        token = team.new_token("through-restart")
        before = [team.pid("node1"), team.pid("node2")]
        with Load(token) as load:
            load.go_on(10)
            team.process.send_signal(signal.SIGHUP)
            team.wait_until(lambda: any("node2 restarted" in line for line in team.said), "both restarted")
            load.go_on(10)
        self.assertEqual(load.faults, [])
        self.assertFalse({team.pid("node1"), team.pid("node2")} & set(before))


if __name__ == "__main__":
    harness.main()
