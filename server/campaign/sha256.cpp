#include "server/campaign/sha256.h"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <stdexcept>

namespace selenograph::server {

struct Sha256::State {
  EVP_MD_CTX* context = ::EVP_MD_CTX_new();
  ~State() { ::EVP_MD_CTX_free(context); }
};

namespace {

void require_success(int success) {
  if (success != 1) throw std::runtime_error("SHA-256 failed in libcrypto");
}

}  // namespace

Sha256::Sha256() : state_(std::make_unique<State>()) {
  require_success(::EVP_DigestInit_ex(state_->context, ::EVP_sha256(), nullptr));
}

Sha256::~Sha256() = default;

void Sha256::add(std::string_view bytes) {
  require_success(::EVP_DigestUpdate(state_->context, bytes.data(), bytes.size()));
}

std::string Sha256::hex() const {
  const State copy;
  require_success(::EVP_MD_CTX_copy_ex(copy.context, state_->context));
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  require_success(::EVP_DigestFinal_ex(copy.context, digest, &size));
  std::string text;
  for (unsigned int i = 0; i < size; ++i) text += fmt::format("{:02x}", digest[i]);
  return text;
}

std::string sha256(std::string_view bytes) {
  Sha256 digest;
  digest.add(bytes);
  return digest.hex();
}

}  // namespace selenograph::server
