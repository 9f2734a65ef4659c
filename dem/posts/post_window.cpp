#include "dem/posts/post_window.h"

#include <algorithm>

#include "dem/posts/post_kernels.h"

namespace selenograph::dem {

void SourceRows::set(int row, const SourceMark* marks) {
  clear(row);
  for (int c = 0; c < columns_;) {
    const SourceMark mark = marks[c];
    c += static_cast<int>(count_equal(marks + c, static_cast<std::size_t>(columns_ - c)));
    append(row, mark, c);
  }
}

SourceMark SourceRows::mark(int row, int column) const {
  const std::span<const SourceRun> runs = this->row(row);
  return std::upper_bound(runs.begin(), runs.end(), column,
                          [](int c, const SourceRun& run) { return c < run.past_last; })
      ->mark;
}

void SourceRows::expand(int row, SourceMark* marks) const {
  int c = 0;
  for (const SourceRun& run : this->row(row)) {
    std::fill_n(marks + c, run.past_last - c, run.mark);
    c = run.past_last;
  }
}

}  // namespace selenograph::dem
