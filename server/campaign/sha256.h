// SHA-256 (FIPS 180-4), in the notation of sha256sum. No other pair of files uses OpenSSL's digests.
#pragma once

#include <memory>
#include <string>
#include <string_view>

namespace selenograph::server {

class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;

  void add(std::string_view bytes);
  // Returns the digest of everything added so far: 64 hexadecimal digits.
  std::string hex() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

std::string sha256(std::string_view bytes);

}  // namespace selenograph::server
