"""What `cmake --install` and the Debian package bring, and that it works from there. SELENOGRAPH_BUILD names the build folder.

Needs cmake, and for the package dpkg-dev and file (deploy/install-packages package). systemd itself does not run here: its
tools check the unit, and the unit's command line is started.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import unittest

import harness
from harness import BINARY, PATIENCE_S, tearDownModule

BUILD = os.environ.get("SELENOGRAPH_BUILD", "")


def setUpModule():
    if not BUILD:
        raise unittest.SkipTest("SELENOGRAPH_BUILD is not set")
    harness.set_up()
    harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "1", "--columns", "1", "--ppd", "64")


def run(*command, **options):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=PATIENCE_S * 5, **options)


def help_of(*command):
    return subprocess.run([BINARY, *command, "--help"], check=True, stdout=subprocess.PIPE, text=True).stdout


def subcommands(*command):
    text = help_of(*command)
    listed = text[text.index("\nSubcommands:"):] if "\nSubcommands:" in text else ""
    return re.findall(r"^  ([a-z][a-z-]*) ", listed, re.M)


def options_of(*command):
    return set(re.findall(r"^ *(?:-\w,)?(--[a-z0-9-]+)", help_of(*command), re.M))


class Works:
    """What is below self.root, and etc and usr as the package or the installation has them."""

    def unit_command(self, usr):
        with open(os.path.join(usr, "lib", "systemd", "system", "selenograph.service")) as file:
            [command] = re.findall(r"^ExecStart=(.*)$", file.read(), re.M)
        return command.split()

    def check_starts(self, binary, serve, *options):
        """It starts over this machine's DEM and answers."""
        self.assertEqual(serve, "serve")
        service = harness.Service(binary=binary, options=[*options, "--port", "0", "--cache-dir", harness.path("cache"),
                                                          "--dem", harness.path("dem")])
        self.assertEqual(service.frame(harness.frame_request())[0], 200)
        self.assertIn('{"time":"', service.log_text())  # log-format = "json"
        self.assertEqual(service.stop(), 0)

    def check_service(self, etc, usr, said_etc, said_usr):
        """The unit's command line, with all members of the configuration and the paths that are said in their place."""
        with open(os.path.join(etc, "selenograph", "selenograph.toml")) as file:
            example = file.read()
        # What stands there as a default, too.
        example = re.sub(r"^# ([a-z-]+ = )", r"\1", example, flags=re.M)
        self.assertGreater(len(re.findall(r"^[a-z-]+ = ", example, re.M)), 8)
        config = harness.path("all.toml")
        with open(config, "w") as file:
            file.write(example)
        self.assertEqual(self.unit_command(usr), [f"{said_usr}/bin/selenograph", "serve", "--config",
                                                  f"{said_etc}/selenograph/selenograph.toml"])
        self.check_starts(os.path.join(usr, "bin", "selenograph"), "serve", "--config", config, "--assets-dir",
                         os.path.join(usr, "share", "selenograph", "assets"))

    def check_image(self, usr):
        """The library of images is found from there."""
        harness.write("request.json", json.dumps({
            "camera": {"width": 8, "height": 8, "fov_deg": 5}, "products": ["image"],
            "pose": {"geodetic": {"lat_deg": -0.5, "lon_deg": 29.5, "height_m": 10000}, "nadir": {}},
            "sun": {"local": {"lat_deg": -0.5, "lon_deg": 29.5, "azimuth_deg": 90, "elevation_deg": 30}}}))
        done = run(os.path.join(usr, "bin", "selenograph"), "ask", "frames", harness.path("request.json"), "-o",
                   harness.path("frame.png"), "--dem", harness.path("dem"))
        self.assertEqual(done.returncode, 0, done.stdout)

    def check_files(self, usr):
        for name in ("bin/selenograph", "lib/selenograph/libselenograph_images.so",
                     "include/selenograph_client.hpp", "lib/python3/dist-packages/selenograph/__init__.py",
                     *(f"share/cmake/selenograph-client/selenograph-client-{part}.cmake"
                       for part in ("config", "config-version", "targets")),
                     "share/man/man1/selenograph.1", "share/bash-completion/completions/selenograph",
                     "share/selenograph/assets/objects/satellite.obj", "share/selenograph/haproxy/haproxy.cfg",
                     "share/selenograph/grafana/selenograph.json", "share/selenograph/prometheus/alerts.yml",
                     "share/selenograph/requests/example-request.json", "share/doc/selenograph/copyright",
                     "share/doc/selenograph/selenograph.spdx.json",
                     "share/doc/selenograph/README.md", "share/doc/selenograph/operation/README.md",
                     "lib/systemd/system/selenograph.service", "lib/sysusers.d/selenograph.conf"):
            self.assertTrue(os.path.isfile(os.path.join(usr, name)), name)
        self.assertTrue(os.access(os.path.join(usr, "share/selenograph/haproxy/token"), os.X_OK))


class Installed(Works, unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.prefix = harness.path("prefix")
        done = run("cmake", "--install", BUILD, "--prefix", cls.prefix)
        assert done.returncode == 0, done.stdout

    def test_files_and_service(self):
        self.check_files(self.prefix)
        etc = os.path.join(self.prefix, "etc")
        self.check_service(etc, self.prefix, etc, self.prefix)
        self.check_starts(*self.unit_command(self.prefix))  # as it was installed
        self.check_image(self.prefix)
        version = run(os.path.join(self.prefix, "bin", "selenograph"), "--version")
        self.assertEqual(version.stdout, run(BINARY, "--version").stdout)

    def test_what_names_a_path_names_the_prefix(self):
        for name in ("etc/selenograph/selenograph.toml", "share/man/man1/selenograph.1", "lib/systemd/system/selenograph.service"):
            with open(os.path.join(self.prefix, name)) as file:
                text = file.read()
            self.assertNotIn("/usr/", text, name)
            named = re.findall(re.escape(self.prefix) + r"/[\w./-]*\w", text)
            self.assertTrue(named, name)
            for path in named:
                self.assertTrue(os.path.exists(path), f"{name}: {path}")

    def test_an_edited_configuration_stays(self):
        path = os.path.join(self.prefix, "etc", "selenograph", "selenograph.toml")
        with open(path, "a") as file:
            file.write("# mine\n")
        self.assertEqual(run("cmake", "--install", BUILD, "--prefix", self.prefix).returncode, 0)
        with open(path) as file:
            self.assertTrue(file.read().endswith("# mine\n"))

    def test_python_client(self):
        done = run(sys.executable, "-c", "import selenograph; print(selenograph.__file__)", cwd=harness.path(),
                   env={**os.environ, "PYTHONPATH": os.path.join(self.prefix, "lib", "python3", "dist-packages"),
                        "PYTHONDONTWRITEBYTECODE": "1"})
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertIn(self.prefix, done.stdout)

    def test_cpp_client(self):
        """A project elsewhere finds the client, is built with it, and asks the service; not of a version to come."""
        prefix = harness.path("moved")  # nothing in it knows where it was installed
        shutil.copytree(self.prefix, prefix, symlinks=True)
        os.makedirs(harness.path("consumer"))
        harness.write(os.path.join("consumer", "CMakeLists.txt"), """
            cmake_minimum_required(VERSION 3.25)
            project(consumer CXX)
            find_package(selenograph-client ${WANTED} REQUIRED)
            add_executable(consumer main.cpp)
            target_link_libraries(consumer PRIVATE selenograph::client)
            """)
        harness.write(os.path.join("consumer", "main.cpp"), """
            #include <selenograph_client.hpp>
            #include <cstdio>
            int main(int, char** arguments) {
              selenograph::Client client(arguments[1]);
              std::printf("%.17g", client.heights({{-0.5, 29.5}}).at(0).height_m);
            }
            """)

        def configure(wanted):
            return run("cmake", "-S", harness.path("consumer"), "-B", harness.path("consumer", "build"),
                       f"-DCMAKE_PREFIX_PATH={prefix}", f"-DWANTED={wanted}")

        version = re.search(r"[0-9]+[.][0-9]+", run(BINARY, "--version").stdout)[0]
        refused = configure("99.0")
        self.assertNotEqual(refused.returncode, 0)
        self.assertIn("99.0", refused.stdout)
        done = configure(version)
        self.assertEqual(done.returncode, 0, done.stdout)
        done = run("cmake", "--build", harness.path("consumer", "build"))
        self.assertEqual(done.returncode, 0, done.stdout)
        service = harness.Service()
        said = run(harness.path("consumer", "build", "consumer"), f"http://{service.host}:{service.port}")
        asked = json.loads(service.post("/v1/heights", {"points": [{"lat_deg": -0.5, "lon_deg": 29.5}]})[2])
        service.expect_clean_stop()
        self.assertEqual(said.returncode, 0, said.stdout)
        self.assertEqual(float(said.stdout), asked["points"][0]["height_m"])

    @unittest.skipUnless(shutil.which("man"), "man is not installed")
    def test_man_takes_the_manual(self):
        done = run("man", "-l", "--warnings", os.path.join(self.prefix, "share/man/man1/selenograph.1"),
                   env={**os.environ, "MANPAGER": "cat", "MAN_KEEP_FORMATTING": "0", "MANWIDTH": "160"})  # of long paths
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertNotIn("warning", done.stdout)

    def completions(self, *words):
        script = (f"source {self.prefix}/share/bash-completion/completions/selenograph; COMP_WORDS=(\"$@\"); "
                  "COMP_CWORD=$(($# - 1)); _selenograph; printf '%s\\n' \"${COMPREPLY[@]}\"")
        done = run("bash", "-c", script, "bash", "selenograph", *words, cwd=harness.path(),
                   env={**os.environ, "PATH": f"{self.prefix}/bin:{os.environ['PATH']}"})
        self.assertEqual(done.returncode, 0, done.stdout)
        return set(done.stdout.split())

    def test_completion(self):
        self.assertLessEqual(set(subcommands()), self.completions(""))
        self.assertEqual(self.completions("serv"), {"serve"})
        self.assertEqual(self.completions("--v"), {"--version"})
        for command in (["serve"], ["ask"], ["verify", "roundtrip"]):
            self.assertEqual(self.completions(*command, "--"), options_of(*command), command)
        self.assertEqual(self.completions("verify", "r"), {"roundtrip"})
        self.assertEqual(self.completions("ask", "ro"), {"root"} if os.path.isdir(harness.path("root")) else set())
        self.assertEqual(self.completions("serve", "--dem", "x", "--cache-m"), {"--cache-mb"})
        self.assertEqual(self.completions("serve", "--page", ""), {"off", "local", "on"})
        self.assertEqual(self.completions("serve", "--log-format", "j"), {"json"})
        self.assertEqual(self.completions("serve", "--on-data-error", ""), {"fail", "fall-through"})
        self.assertEqual(self.completions("serve", "--dem", "de"), {"dem"})
        # batch takes a manifest, and has a command.
        harness.write("campaign.jsonl", "")
        self.assertLessEqual({"verify", "campaign.jsonl"}, self.completions("batch", ""))
        self.assertEqual(self.completions("batch", "cam"), {"campaign.jsonl"})
        self.assertEqual(self.completions("batch", "veri"), {"verify"})
        self.assertEqual(self.completions("batch", "campaign.jsonl", "-o", "de"), {"dem"})
        self.assertEqual(self.completions("batch", "campaign.jsonl", "veri"), set())
        self.assertEqual(self.completions("batch", "verify", "cam"), {"campaign.jsonl"})
        self.assertEqual(self.completions("verify", "cam"), set())

    @unittest.skipUnless(shutil.which("systemd-analyze"), "systemd-analyze is not installed: apt-get install systemd")
    def test_systemd_takes_the_unit(self):
        with open(os.path.join(self.prefix, "lib", "systemd", "system", "selenograph.service")) as file:
            unit = file.read()
        copy = harness.path("selenograph.service")
        with open(copy, "w") as file:  # the manual page isn't installed in this system, either
            file.write(unit.replace("Documentation=man:selenograph(1)\n", ""))
        done = run("systemd-analyze", "verify", copy)
        self.assertEqual((done.returncode, done.stdout), (0, ""))
        done = run("systemd-analyze", "security", "--offline=true", "--no-pager", copy)
        exposure = float(re.search(r"Overall exposure level for selenograph.service: ([0-9.]+)", done.stdout)[1])
        self.assertLess(exposure, 5, done.stdout)


@unittest.skipUnless(shutil.which("dpkg-shlibdeps") and shutil.which("file"),
                     "dpkg-shlibdeps or file is not installed: deploy/install-packages package")
class DebianPackage(Works, unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        done = run("cpack", "-G", "DEB", "-B", harness.path("packages"), cwd=BUILD)
        assert done.returncode == 0, done.stdout
        [name] = [name for name in os.listdir(harness.path("packages")) if name.endswith(".deb")]
        cls.deb = harness.path("packages", name)
        cls.root = harness.path("root")
        subprocess.run(["dpkg-deb", "-x", cls.deb, cls.root], check=True)
        subprocess.run(["dpkg-deb", "-e", cls.deb, harness.path("control")], check=True)

    def test_files_and_service(self):
        self.check_files(os.path.join(self.root, "usr"))
        self.check_service(os.path.join(self.root, "etc"), os.path.join(self.root, "usr"), "/etc", "/usr")
        self.check_image(os.path.join(self.root, "usr"))
        self.assertEqual(sorted(os.listdir(self.root)), ["etc", "usr"])

    def test_what_dpkg_is_told(self):
        fields = run("dpkg-deb", "-f", self.deb).stdout
        for library in ("libgdal", "libembree", "libopenimageio", "libc6"):
            self.assertRegex(fields, rf"(?m)^Depends: .*\b{library}")
        self.assertRegex(fields, r"(?m)^Depends: .*\bsystemd \| systemd-standalone-sysusers")
        self.assertRegex(fields, r"(?m)^Package: selenograph$")
        with open(harness.path("control", "conffiles")) as file:
            self.assertEqual(file.read(), "/etc/selenograph/selenograph.toml\n")
        for script in ("postinst", "prerm", "postrm"):
            path = harness.path("control", script)
            self.assertEqual(os.stat(path).st_mode & 0o777, 0o755, script)
            self.assertEqual(run("sh", "-n", path).returncode, 0, script)
        listed = run("dpkg-deb", "-c", self.deb).stdout
        self.assertEqual([line for line in listed.splitlines() if " root/root " not in line], [])
        self.assertEqual([line for line in listed.splitlines() if re.match(r"[^l][rwx-]{4}w|[^l][rwx-]{7}w", line)], [])


if __name__ == "__main__":
    harness.main()
