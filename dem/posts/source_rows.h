// Where the posts of a grid come from, row by row: runs of the same source. Most rows are one, or one for each file
// that they cross: next to nothing, where a mark for each post is as much as its height.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "dem/grid/block.h"

namespace selenograph::dem {

struct SourceRun {
  SourceMark mark;
  int past_last;  // column
};

// Rows are independent: different threads may set different ones.
class SourceRows {
 public:
  void reset(int rows, int columns) {
    rows_.resize(static_cast<std::size_t>(rows));
    columns_ = columns;
  }
  int rows() const { return static_cast<int>(rows_.size()); }
  int columns() const { return columns_; }

  // A mark for each column.
  void set(int row, const SourceMark* marks);
  // All columns, once their runs have been appended from the first on.
  void clear(int row) { at(row).clear(); }
  void append(int row, SourceMark mark, int past_last) {
    std::vector<SourceRun>& runs = at(row);
    if (!runs.empty() && runs.back().mark == mark)
      runs.back().past_last = past_last;
    else if (past_last > (runs.empty() ? 0 : runs.back().past_last))
      runs.push_back({mark, past_last});
  }

  std::span<const SourceRun> row(int row) const { return rows_[static_cast<std::size_t>(row)]; }
  std::span<SourceRun> row(int row) { return at(row); }
  SourceMark mark(int row, int column) const;
  // The opposite of set().
  void expand(int row, SourceMark* marks) const;

 private:
  std::vector<SourceRun>& at(int row) { return rows_[static_cast<std::size_t>(row)]; }

  std::vector<std::vector<SourceRun>> rows_;
  int columns_ = 0;
};

}  // namespace selenograph::dem
