// Messages that libraries would print to stderr: they go to the log instead.
//
// A library prints from the thread of a request. When nobody reads stderr, that thread would wait for ever.
#pragma once

#include <atomic>
#include <exception>
#include <string>

namespace selenograph::dem {

// Takes a library's message, without waiting. Null: messages are dropped.
using LibraryLog = void (*)(const std::string& text);
inline std::atomic<LibraryLog> library_log{nullptr};

// Passes a message on. It throws nothing, since C libraries call it.
inline void pass_to_log(const char* library, const char* text) noexcept {
  const LibraryLog log = library_log;
  if (!log) return;
  try {
    log(std::string(library) + ": " + text);
  } catch (const std::exception&) {  // no memory for the text
  }
}

}  // namespace selenograph::dem
