// Sources of a grid's posts as runs, row by row. Most rows have one run, or one per file that they cross, which takes
// little memory; one mark per post would take as much memory as its height.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "dem/grid/block.h"

namespace selenograph::dem {

struct SourceRun {
  SourceMark mark;
  int past_last;  // column after the run's last one
};

// Run-length encoded sources. Several threads may set different rows at once.
class SourceRows {
 public:
  void reset(int rows, int columns) {
    rows_.resize(static_cast<std::size_t>(rows));
    columns_ = columns;
  }
  int rows() const { return static_cast<int>(rows_.size()); }
  int columns() const { return columns_; }

  // Sets a row from one mark per column.
  void set(int row, const SourceMark* marks);
  // Clears a row, before its runs are appended from the first column on.
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
  // Writes a row's runs as one mark per column: the inverse of set().
  void expand(int row, SourceMark* marks) const;

 private:
  std::vector<SourceRun>& at(int row) { return rows_[static_cast<std::size_t>(row)]; }

  std::vector<std::vector<SourceRun>> rows_;
  int columns_ = 0;
};

}  // namespace selenograph::dem
