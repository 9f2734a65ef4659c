// Tests without a service: the npz reader, poses, and the handling of broken connections and faulty answers.
#include <gtest/gtest.h>

#include <atomic>
#include <selenograph_client.hpp>

namespace {

using namespace selenograph;

// Returns a value as this many little-endian bytes.
std::string little(std::uint64_t value, int bytes) {
  std::string text;
  for (int i = 0; i < bytes; ++i, value >>= 8) text += static_cast<char>(value & 0xff);
  return text;
}

// Returns an .npy file: NumPy's code of the element type, the shape as Python writes it, the elements' bytes.
std::string npy(const std::string& descr, const std::string& shape, const std::string& data,
                const std::string& order = "False") {
  const std::string dictionary =
      "{'descr': '" + descr + "', 'fortran_order': " + order + ", 'shape': (" + shape + "), }\n";
  return std::string("\x93NUMPY\x01\x00", 8) + little(dictionary.size(), 2) + dictionary + data;
}

// Returns a zip of stored members: for each a local header with its data, then the central directory with an entry for
// each, then the end record. The checksums are zero: the reader leaves integrity to TCP.
std::string zip(const std::vector<std::pair<std::string, std::string>>& members, std::uint64_t method = 0) {
  std::string local, directory;
  for (const auto& [name, data] : members) {
    // Fields that both headers have: method, time, date and checksum, packed and unpacked size, length of the name.
    const std::string common =
        little(method, 2) + little(0, 8) + little(data.size(), 4) + little(data.size(), 4) + little(name.size(), 2);
    directory += "PK\x01\x02" + little(20, 2) + little(20, 2) + little(0, 2) + common + little(0, 12) +
                 little(local.size(), 4) + name;
    local += "PK\x03\x04" + little(20, 2) + little(0, 2) + common + little(0, 2) + name + data;
  }
  return local + directory + "PK\x05\x06" + little(0, 4) + little(members.size(), 2) + little(members.size(), 2) +
         little(directory.size(), 4) + little(local.size(), 4) + little(0, 2);
}

// Returns the values' bytes as they are in memory.
template <typename T>
std::string raw(std::initializer_list<T> values) {
  std::string bytes;
  for (const T value : values) bytes.append(reinterpret_cast<const char*>(&value), sizeof(T));
  return bytes;
}

// An HTTP server with one handler for all paths, on a free port of the loopback interface.
class Fake {
 public:
  explicit Fake(const httplib::Server::Handler& handler) {
    server_.Post(".*", handler);
    server_.Get(".*", handler);
    port_ = server_.bind_to_any_port("127.0.0.1");
    thread_ = std::thread([this] { server_.listen_after_bind(); });
    while (!server_.is_running()) std::this_thread::yield();
  }
  ~Fake() {
    server_.stop();
    thread_.join();
  }
  std::string url() const { return "http://127.0.0.1:" + std::to_string(port_); }

 private:
  httplib::Server server_;
  int port_ = 0;
  std::thread thread_;
};

TEST(Npz, ArraysKeepTheirTypeAndShape) {
  const std::string bytes = zip({{"range.npy", npy("<f8", "2, 3", raw<double>({1, 2, 3, 4, 5, 6.5}))},
                                 {"image.npy", npy("<u2", "1, 2", raw<std::uint16_t>({7, 65535}))},
                                 {"normal.npy", npy("<f4", "1, 1, 3", raw<float>({0, 0, 1}))},
                                 {"meta.json", R"({"request": 1})"}});
  const auto members = detail::read_zip(bytes);
  ASSERT_EQ(members.size(), 4u);
  EXPECT_EQ(members.at("meta.json"), R"({"request": 1})");
  const Array range = detail::read_npy(members.at("range.npy"));
  EXPECT_EQ(range.shape, (std::vector<std::size_t>{2, 3}));
  EXPECT_STREQ(range.type(), "float64");
  EXPECT_EQ(range.at(1, 2), 6.5);
  EXPECT_EQ(range.as<double>()[3], 4);
  EXPECT_THROW(range.as<float>(), Error);
  EXPECT_THROW(range.at(2, 0), Error);
  EXPECT_EQ(detail::read_npy(members.at("image.npy")).at(0, 1), 65535);
  const Array normal = detail::read_npy(members.at("normal.npy"));
  EXPECT_EQ(normal.channels(), 3u);
  EXPECT_EQ(normal.at(0, 0, 2), 1);
}

TEST(Npz, ReadsTruthValuesAndWholeNumbersOf64Bits) {
  const Array found = detail::read_npy(npy("|b1", "3,", raw<std::uint8_t>({1, 0, 1})));
  EXPECT_EQ(found.as<std::uint8_t>(), (std::vector<std::uint8_t>{1, 0, 1}));
  const Array rock = detail::read_npy(npy("<u8", "2,", raw<std::uint64_t>({0xfedcba9876543211, 1})));
  EXPECT_STREQ(rock.type(), "uint64");
  EXPECT_EQ(rock.as<std::uint64_t>()[0], 0xfedcba9876543211);
  EXPECT_EQ(rock.at(1, 0), 1);
}

TEST(Npz, ReadsHalvesAsFloats) {
  const Array range = detail::read_npy(
      npy("<f2", "2, 4", raw<std::uint16_t>({0x3c00, 0xc000, 0x7bff, 0x0400, 0x0001, 0x8000, 0xfc00, 0x7e00})));
  EXPECT_STREQ(range.type(), "float32");
  const std::vector<float>& values = range.as<float>();
  EXPECT_EQ(std::vector<float>(values.begin(), values.end() - 1),
            (std::vector<float>{1, -2, 65504, 0x1p-14F, 0x1p-24F, 0, -std::numeric_limits<float>::infinity()}));
  EXPECT_TRUE(std::signbit(values[5]));
  EXPECT_TRUE(std::isnan(values[7]));
}

TEST(Npz, RejectsTruncatedArchives) {
  const std::string archive = zip({{"a.npy", npy("<f8", "1, 2", raw<double>({1, 2}))}});
  for (std::size_t size = 0; size < archive.size(); ++size) {
    EXPECT_THROW(detail::read_zip(std::string_view(archive).substr(0, size)), BadAnswer) << size;
  }
  const std::string array = npy("<f8", "1, 2", raw<double>({1, 2}));
  for (std::size_t size = 0; size < array.size(); ++size) {
    EXPECT_THROW(detail::read_npy(std::string_view(array).substr(0, size)), BadAnswer) << size;
  }
}

TEST(Npz, RejectsUnsupportedArrays) {
  EXPECT_THROW(detail::read_zip(zip({{"a.npy", "x"}}, 8)), BadAnswer);
  EXPECT_THROW(detail::read_npy(npy("<c16", "1", std::string(16, '\0'))), BadAnswer);
  EXPECT_THROW(detail::read_npy(npy("<f8", "1, 2", std::string(16, '\0'), "True")), BadAnswer);
  EXPECT_THROW(detail::read_npy(npy("<f8", "1, 3", std::string(16, '\0'))), BadAnswer);
  EXPECT_THROW(detail::read_npy(npy("<f8", "4294967296, 4294967296", "")), BadAnswer);
}

TEST(Npz, NoChangedByteReadsOutOfBounds) {
  const std::string archive = zip({{"a.npy", npy("<f8", "1, 2", raw<double>({1, 2}))}, {"meta.json", "{}"}});
  for (std::size_t at = 0; at < archive.size(); ++at) {
    for (const char changed : {'\0', '\x7f', '\xff'}) {
      std::string bytes = archive;
      bytes[at] = changed;
      try {
        for (const auto& [name, member] : detail::read_zip(bytes)) {
          if (name != "meta.json") detail::read_npy(member);
        }
      } catch (const BadAnswer&) {
      }
    }
  }
}

TEST(ServerTiming, StagesByName) {
  const auto times = detail::read_timing("parse;dur=0.125, queue;desc=\"x\";dur=2,cache");
  ASSERT_EQ(times.size(), 2u);
  EXPECT_EQ(times.at("parse"), 0.125);
  EXPECT_EQ(times.at("queue"), 2);
}

void expect_near(const Vector3& a, const Vector3& b) {
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(a[i], b[i], 1e-15);
}

TEST(Attitude, QuaternionRotatesVectors) {
  const double half = std::sqrt(0.5);  // a quarter of a turn about z takes x to y
  expect_near(Quaternion::wxyz(half, 0, 0, half).rotate({1, 0, 0}), {0, 1, 0});
  expect_near(Quaternion::xyzw(0, 0, half, half).rotate({1, 0, 0}), {0, 1, 0});
  const Quaternion a = Quaternion::wxyz(half, half, 0, 0), b = Quaternion::wxyz(half, 0, 0, half);
  expect_near((a * b).rotate({1, 2, 3}), a.rotate(b.rotate({1, 2, 3})));
  expect_near(a.inverse().rotate(a.rotate({1, 2, 3})), {1, 2, 3});
}

TEST(Attitude, ConvertsMatricesAndMrps) {
  // Make each of the four components the largest once: matrix() has a branch for each.
  for (const Vector3& s : {Vector3{0.1, 0.2, -0.3}, {0.9, 0.1, 0.2}, {-0.1, 0.8, 0.3}, {0.2, 0.1, -0.95}}) {
    const double square = s[0] * s[0] + s[1] * s[1] + s[2] * s[2];
    // The matrix of the cross product: tilde v = s x v.
    const Matrix3 tilde{{{0, -s[2], s[1]}, {s[2], 0, -s[0]}, {-s[1], s[0], 0}}};
    // [BN] of Schaub and Junkins, Analytical Mechanics of Space Systems: the direction cosine matrix of the MRP sigma =
    // s.
    Matrix3 bn{};
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) {
        double tilde_squared = 0;
        for (std::size_t k = 0; k < 3; ++k) tilde_squared += tilde[i][k] * tilde[k][j];
        bn[i][j] = (i == j) + (8 * tilde_squared - 4 * (1 - square) * tilde[i][j]) / ((1 + square) * (1 + square));
      }
    }
    const Vector3 v{1, -2, 0.5};
    Vector3 turned{};
    for (std::size_t i = 0; i < 3; ++i) turned[i] = bn[i][0] * v[0] + bn[i][1] * v[1] + bn[i][2] * v[2];
    expect_near(Quaternion::mrp(s).rotate(v), turned);
    expect_near(Quaternion::matrix(bn).rotate(v), turned);
  }
}

TEST(Pose, HasTheServicesMembers) {
  const Json turned = pose::camera_from_moon(pose::cartesian({1757400, 0, 0}), Quaternion::wxyz(1, 0, 0, 0));
  EXPECT_EQ(turned, Json::parse(R"({"position_m": [1757400.0, 0.0, 0.0],
                                    "camera_from_moon": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}})"));
  EXPECT_EQ(pose::nadir(pose::geodetic(1, 2, 3), 90),
            Json::parse(R"({"geodetic": {"lat_deg": 1.0, "lon_deg": 2.0, "height_m": 3.0},
                            "nadir": {"up_azimuth_deg": 90.0}})"));
  EXPECT_EQ(pose::look_at(Json::object(), {4, 5}, {0, 0, 1}),
            Json::parse(R"({"look_at": {"lat_deg": 4.0, "lon_deg": 5.0, "height_m": 0.0, "up": [0, 0, 1]}})"));
}

TEST(Faults, RefusalListsInvalidMembers) {
  Fake fake([](const httplib::Request&, httplib::Response& response) {
    response.status = 422;
    response.set_content(R"({"title": "Invalid request", "status": 422, "detail": "two faults", "errors": [
      {"pointer": "/camera/width", "detail": "is negative"}, {"pointer": "/sun", "detail": "is missing"}]})",
                         "application/problem+json");
  });
  Client client(fake.url());
  try {
    client.frame(Json::object());
    FAIL();
  } catch (const Refused& refused) {
    EXPECT_EQ(refused.status, 422);
    EXPECT_EQ(refused.problem["detail"], "two faults");
    EXPECT_EQ(refused.pointers, (std::vector<std::string>{"/camera/width", "/sun"}));
    EXPECT_NE(std::string(refused.what()).find("/camera/width: is negative"), std::string::npos);
  }
}

TEST(Faults, RefusalsMayBeOtherThanProblemDocuments) {
  for (const char* body : {"", "<html>", "[]", R"({"title": 1, "errors": ["x", {"pointer": 2}, {"pointer": "/sun"}]})",
                           R"({"errors": {"pointer": "/sun"}})"}) {
    Fake fake([&](const httplib::Request&, httplib::Response& response) {
      response.status = 502;
      response.set_content(body, "text/plain");
    });
    try {
      Client(fake.url()).datasets();
      FAIL();
    } catch (const Refused& refused) {
      EXPECT_EQ(refused.status, 502);
      EXPECT_EQ(std::string(refused.what()).substr(0, 4), "502 ");
    }
  }
}

TEST(Faults, RetriesWhenRetryAfterSays) {
  std::atomic<int> request_count = 0;
  Fake fake([&](const httplib::Request&, httplib::Response& response) {
    if (++request_count < 3) {
      response.status = request_count == 1 ? 429 : 503;
      response.set_header("Retry-After", request_count == 1 ? "0" : "1");
    } else {
      response.set_content(R"({"points": [{"lat_deg": 1, "lon_deg": 2, "height_m": null, "reason": "no data"}]})",
                           "application/json");
    }
  });
  Client client(fake.url() + "/", "secret", std::chrono::seconds(60));
  const auto start = std::chrono::steady_clock::now();
  const std::vector<Height> heights = client.heights({{1, 2}});
  EXPECT_GE(std::chrono::steady_clock::now() - start, std::chrono::seconds(1));
  EXPECT_EQ(request_count, 3);
  ASSERT_EQ(heights.size(), 1u);
  EXPECT_TRUE(std::isnan(heights[0].height_m));
  EXPECT_EQ(heights[0].reason, "no data");
}

TEST(Faults, DoesNotWaitBeyondTheTimeout) {
  Fake fake([](const httplib::Request&, httplib::Response& response) {
    response.status = 503;
    response.set_header("Retry-After", "100");
  });
  EXPECT_THROW(Client(fake.url(), "", std::chrono::seconds(30)).datasets(), Refused);
}

TEST(Faults, SlowServiceTimesOut) {
  std::atomic<bool> done = false;
  Fake fake([&](const httplib::Request&, httplib::Response&) {
    while (!done) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  });
  EXPECT_THROW(Client(fake.url(), "", std::chrono::milliseconds(100)).datasets(), NoAnswer);
  done = true;
}

TEST(Faults, NothingListens) {
  EXPECT_THROW(Client("http://127.0.0.1:1").datasets(), NoAnswer);
  EXPECT_THROW(Client("127.0.0.1"), Error);
}

TEST(Faults, RejectsAnswersThatAreNotHttp) {
  Fake fake([](const httplib::Request&, httplib::Response& response) { response.set_content("<html>", "text/html"); });
  Client client(fake.url());
  EXPECT_THROW(client.datasets(), BadAnswer);
  EXPECT_THROW(client.frame(Json::object()), BadAnswer);
  EXPECT_THROW(client.rays({{}}), BadAnswer);
}

TEST(Client, SendsTokenAndPrefixAndSplitsLongLists) {
  std::mutex mutex;
  std::vector<std::size_t> sizes;
  Fake fake([&](const httplib::Request& request, httplib::Response& response) {
    const std::lock_guard lock(mutex);
    EXPECT_EQ(request.path, "/moon/v1/rays");
    EXPECT_EQ(request.get_header_value("Authorization"), "Bearer secret");
    EXPECT_EQ(request.get_header_value("Selenograph-Region"), "22-0");
    const Json received = Json::parse(request.body);
    sizes.push_back(received["rays"].size());
    Json answer{{"rays", Json::array()}};
    for (const Json& ray : received["rays"]) {
      answer["rays"].push_back(
          {{"hit", true}, {"range_m", ray["origin_m"][0]}, {"position_m", ray["origin_m"]}, {"normal", {0, 0, 1}}});
    }
    response.set_content(answer.dump(), "application/json");
  });
  std::vector<Ray> rays(10001);
  for (std::size_t i = 0; i < rays.size(); ++i) rays[i] = {{double(i), 0, 0}, {1, 0, 0}};
  const std::vector<RayHit> hits = Client(fake.url() + "/moon/", "secret").rays(rays);
  const std::lock_guard lock(mutex);
  EXPECT_EQ(sizes, (std::vector<std::size_t>{10000, 1}));
  ASSERT_EQ(hits.size(), rays.size());
  EXPECT_EQ(hits[10000].range_m, 10000);
  EXPECT_TRUE(std::isnan(hits[0].lit));
}

TEST(Client, TokensThatNoHeaderTakesAreRefused) {
  for (const char* token : {"a\nb", "a\r\nX: y", "two words", "na\u00efve"})
    EXPECT_THROW(Client("http://127.0.0.1:1", token), Error) << token;
}

// The header is ROW-COLUMN of a cell: rows of 4 degrees from the south pole, columns eastward from longitude 0; empty
// where the request is about no evident place. The same cases are in tests/python_client_test.py.
TEST(Client, RegionHeader) {
  for (const auto& [request, region] : std::vector<std::pair<const char*, const char*>>{
           {R"({"pose":{"geodetic":{"lat_deg":0.1,"lon_deg":30.1,"height_m":20000}}})", "22-7"},
           {R"({"pose":{"position_m":[1757400,0,0]}})", "22-0"},
           {R"({"pose":{"position_m":[1757400,-0.1,-0.1]}})", "22-89"},
           {R"({"pose":{"position_m":[0,0,1800000],"frame":"MOON_PA_DE440"}})", "44-0"},
           {R"({"pose":{"geodetic":{"lat_deg":-90,"lon_deg":-180,"height_m":0}}})", "0-1"},
           {R"({"pose":{"geodetic":{"lat_deg":90,"lon_deg":360,"height_m":0}}})", "44-0"},
           {R"({"pose":{"geodetic":{"lat_deg":-60.5,"lon_deg":-1,"height_m":0}}})", "7-44"},
           {R"({"pose":{"position_m":[1757400,0,0],"frame":"ICRF","look_at":{"lat_deg":0,"lon_deg":8.1}}})", "22-2"},
           {R"({"pose":{"position_m":[1757400,0,0],"frame":"J2000","look_at":{"lat_deg":0,"lon_deg":8.1}}})", "22-2"},
           {R"({"cameras":{"a":{"pose":{"geodetic":{"lat_deg":0.1,"lon_deg":30.1}}},"b":{}}})", "22-7"},
           {R"({"map":{"center":{"lat_deg":0.1,"lon_deg":30.1}}})", "22-7"},
           {R"({"rays":[{"origin_m":[1757400,0,0]}]})", "22-0"},
           {R"({"points":[{"lat_deg":0.1,"lon_deg":30.1}]})", "22-7"},
           {R"({"camera":{},"pose":{"geodetic":{"lat_deg":0.1,"lon_deg":30.1}},"points":[{"lat_deg":80,"lon_deg":0}]})",
            "22-7"},
           {R"({"pose":{"position_m":[1757400,0,0],"frame":"ICRF"}})", ""},
           {R"({"pose":{"geodetic":{"lat_deg":-91,"lon_deg":0}}})", ""},
           {R"({"pose":{"geodetic":"here"}})", ""},
           {R"({"pose":{"position_m":[1,2]}})", ""},
           {R"({"pose":7})", ""},
           {R"({"points":[]})", ""},
           {R"({})", ""}})
    EXPECT_EQ(detail::region(Json::parse(request)), region) << request;
}

TEST(Client, PointersOfAPartReferToTheWholeList) {
  std::atomic<int> request_count = 0;
  Fake fake([&](const httplib::Request& request, httplib::Response& response) {
    if (++request_count == 1) {
      const std::size_t count = Json::parse(request.body)["points"].size();
      const Json points(count, Json::object());
      response.set_content(Json{{"points", points}}.dump(), "application/json");
      return;
    }
    response.status = 422;
    response.set_content(
        R"({"errors": [{"pointer": "/points/5/lat_deg"}, {"pointer": "/points/17"}, {"pointer": "/points"}, 3]})",
        "application/problem+json");
  });
  try {
    Client(fake.url()).heights(std::vector<Place>(10018, Place{0, 0}));
    FAIL();
  } catch (const Refused& refused) {
    EXPECT_EQ(refused.pointers, (std::vector<std::string>{"/points/10005/lat_deg", "/points/10017", "/points", ""}));
  }
}

TEST(Client, ReadsMapsAndHeaders) {
  Fake fake([](const httplib::Request& request, httplib::Response& response) {
    EXPECT_EQ(request.path, "/v1/maps");
    EXPECT_EQ(request.get_header_value("Accept"), "application/x-npz");
    response.set_header("Server-Timing", "parse;dur=0.5");
    response.set_header("Selenograph-Echo", R"({"n":1})");
    response.set_content(
        zip({{"left/height.npy", npy("<f8", "1, 1", raw<double>({7}))}, {"meta.json", R"({"geotransform": [1, 2]})"}}),
        "application/x-npz");
  });
  const Frame map = Client(fake.url()).map({{"map", {{"gsd_m", 40}}}});
  EXPECT_EQ(map["left/height"].at(0, 0), 7);
  EXPECT_EQ(map.meta["geotransform"], (Json{1, 2}));
  EXPECT_EQ(map.timing_ms.at("parse"), 0.5);
  EXPECT_EQ(map.echo, R"({"n":1})");
  EXPECT_EQ(map.etag, "");
  EXPECT_THROW(map["radiance"], Error);
}

TEST(Client, FramesComeInOrderWithPosesAhead) {
  std::mutex mutex;
  std::map<int, Json> aheads;
  std::atomic<int> in_work = 0, max_in_work = 0;
  Fake fake([&](const httplib::Request& request, httplib::Response& response) {
    // Raise max_in_work to in_work, unless another thread has already raised it further.
    const int now = ++in_work;
    for (int previous = max_in_work; now > previous && !max_in_work.compare_exchange_weak(previous, now);) {
    }
    const Json received = Json::parse(request.body);
    const int step = received["pose"]["step"];
    // Delay each even step until the next odd step has arrived: both must be in flight at the same time.
    for (bool wait = step % 2 == 0; wait; std::this_thread::yield()) {
      const std::lock_guard lock(mutex);
      wait = aheads.count(step + 1) == 0;
    }
    {
      const std::lock_guard lock(mutex);
      aheads[step] = received.value("ahead", Json());
    }
    response.set_header("ETag", "\"" + std::to_string(step) + "\"");
    response.set_content(zip({{"meta.json", "{}"}}), "application/x-npz");
    --in_work;
  });
  std::vector<Json> requests;
  requests.reserve(6);
  for (int i = 0; i < 6; ++i) requests.push_back({{"pose", {{"step", i}}}});
  std::vector<std::string> order;
  Client(fake.url())
      .frames(
          requests,
          [&](std::size_t index, const Frame& frame) {
            EXPECT_EQ(index, order.size());
            order.push_back(frame.etag);
          },
          2, 3);  // two frames in flight, three poses ahead
  EXPECT_EQ(order, (std::vector<std::string>{"\"0\"", "\"1\"", "\"2\"", "\"3\"", "\"4\"", "\"5\""}));
  const std::lock_guard lock(mutex);
  EXPECT_LE(max_in_work, 2);
  EXPECT_EQ(aheads.at(0), Json::parse(R"([{"step": 1}, {"step": 2}, {"step": 3}])"));
  EXPECT_EQ(aheads.at(4), Json::parse(R"([{"step": 5}])"));
  EXPECT_TRUE(aheads.at(5).is_null());
}

// Returns a handler that answers with the step as ETag, and rejects a request for which fault_of() returns a pointer.
httplib::Server::Handler refuses(const std::function<std::string(const Json&)>& fault_of) {
  return [=](const httplib::Request& request, httplib::Response& response) {
    const Json received = Json::parse(request.body);
    if (const std::string pointer = fault_of(received); !pointer.empty()) {
      response.status = 422;
      response.set_content(Json{{"errors", {{{"pointer", pointer}}}}}.dump(), "application/problem+json");
      return;
    }
    response.set_header("ETag", received["pose"]["step"].dump());
    response.set_content(zip({{"meta.json", "{}"}}), "application/x-npz");
  };
}

TEST(Client, FaultsOfPosesAheadAreThoseOfLaterRequests) {
  Fake fake(refuses([](const Json& received) -> std::string {
    if (received["pose"]["step"] == 3) return "/pose/step";
    for (std::size_t i = 0; i < received.value("ahead", Json::array()).size(); ++i) {
      if (received["ahead"][i]["step"] == 3) return "/ahead/" + std::to_string(i) + "/step";
    }
    return "";
  }));
  std::vector<Json> requests(6);
  for (int i = 0; i < 6; ++i) requests[static_cast<std::size_t>(i)] = {{"pose", {{"step", i}}}};
  std::string frames_taken;
  try {
    Client(fake.url()).frames(requests, [&](std::size_t, const Frame& frame) { frames_taken += frame.etag; });
    FAIL();
  } catch (const Refused& refused) {
    EXPECT_EQ(refused.pointers, (std::vector<std::string>{"/pose/step"}));
  }
  EXPECT_EQ(frames_taken, "012");
}

TEST(Client, FaultsOfARequestsOwnAheadAreItsOwn) {
  std::atomic<int> request_count = 0;
  Fake fake(refuses([&](const Json& received) -> std::string {
    ++request_count;
    return received.contains("ahead") ? "/ahead/0" : "";
  }));
  const Json request{{"pose", {{"step", 0}}}, {"ahead", {1}}};
  EXPECT_THROW(Client(fake.url()).frames({request}, [](std::size_t, const Frame&) {}), Refused);
  EXPECT_EQ(request_count, 1);
}

TEST(Client, DeflateIsRefusedBeforeItIsAsked) {
  std::atomic<int> request_count = 0;
  Fake fake([&](const httplib::Request&, httplib::Response&) { ++request_count; });
  Client client(fake.url());
  for (const char* request : {R"({"compression": "deflate"})", R"({"cameras": {"a": {"compression": "deflate"}}})"}) {
    try {
      client.frame(Json::parse(request));
      FAIL();
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("compression"), std::string::npos) << error.what();
    }
  }
  EXPECT_EQ(request_count, 0);
}

TEST(Client, FailureEndsTheSequence) {
  Fake fake([](const httplib::Request& request, httplib::Response& response) {
    if (Json::parse(request.body)["n"] == 2) response.status = 400;
    response.set_content(zip({{"meta.json", "{}"}}), "application/x-npz");
  });
  std::size_t frames_taken = 0;
  EXPECT_THROW(
      Client(fake.url())
          .frames({{{"n", 0}}, {{"n", 1}}, {{"n", 2}}, {{"n", 3}}}, [&](std::size_t, const Frame&) { ++frames_taken; }),
      Refused);
  EXPECT_EQ(frames_taken, 2u);
}

}  // namespace
