// Memory for small things when there is none left: a lack of memory must end in an answer, and unwinding a request
// needs some. (JSON values allocate in their destructors, lists where they give scratch memory back; what throws there
// ends the process.)
//
// operator new of the whole executable and its libraries: malloc() first, and where that fails, blocks that were set
// aside for it. Large requests fail as ever. The blocks cost address space only, until they are used.
#include <array>
#include <cstddef>
#include <cstdlib>
#include <functional>
#include <mutex>
#include <new>

// The sanitizers have allocators of their own.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

namespace {

template <std::size_t block_bytes, std::size_t count>
class Blocks {
 public:
  void* take(std::size_t bytes) noexcept {
    if (bytes > block_bytes) return nullptr;
    const std::lock_guard lock(mutex_);
    if (Free* block = free_) {
      free_ = block->next;
      return block;
    }
    return used_ < count ? memory_.data() + block_bytes * used_++ : nullptr;
  }

  // False: not from here.
  bool give(void* block) noexcept {
    const auto before = std::less<const void*>();
    if (before(block, memory_.data()) || !before(block, memory_.data() + memory_.size())) return false;
    const std::lock_guard lock(mutex_);
    free_ = new (block) Free{free_};
    return true;
  }

 private:
  struct Free {
    Free* next;
  };
  std::mutex mutex_;
  Free* free_ = nullptr;
  std::size_t used_ = 0;
  alignas(std::max_align_t) static inline std::array<std::byte, block_bytes * count> memory_{};
};

constinit Blocks<4096, 4096> small_blocks{};
constinit Blocks<std::size_t{256} << 10, 64> larger_blocks{};

}  // namespace

void* operator new(std::size_t bytes) {
  for (;;) {
    if (void* memory = std::malloc(bytes > 0 ? bytes : 1)) return memory;
    if (void* memory = small_blocks.take(bytes)) return memory;
    if (void* memory = larger_blocks.take(bytes)) return memory;
    const std::new_handler handler = std::get_new_handler();
    if (!handler) throw std::bad_alloc();
    handler();
  }
}

void operator delete(void* memory) noexcept {
  if (!small_blocks.give(memory) && !larger_blocks.give(memory)) std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept { operator delete(memory); }

#endif
