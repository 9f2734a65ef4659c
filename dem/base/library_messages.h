// Redirects messages that libraries would print to stderr to the log.
//
// A library prints from the thread of a request. If stderr is a pipe that no process reads, that thread would block
// forever.
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
