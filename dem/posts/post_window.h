// Windows of the lattice, and their posts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "dem/base/uninitialised.h"
#include "dem/grid/block.h"

namespace selenograph::dem {

// Window of posts: rows of latitude ticks lat0 + r * lat_step, columns of longitude ticks lon0 + c * lon_step. It may
// reach past a pole (rows continue on the opposite meridian) and around the globe.
struct PostWindow {
  Tick lat0 = 0, lon0 = 0;
  Tick lat_step = 1, lon_step = 1;
  int rows = 0, cols = 0;
  std::size_t size() const { return static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols); }
};

// Heights and sources of a window's posts, row by row.
struct Posts {
  std::vector<float> heights;           // m, NaN: no data
  std::vector<SourceMark> sources;      // as in Block::sources
  std::vector<SourceIndex> replaced{};  // unusable files that the next coarser layer replaced; ascending
};

struct SourceRun {
  SourceMark mark;
  int past_last;  // column after the run's last one
};

// Sources of a grid's posts as runs, row by row. Most rows have one run, or one per file that they cross, which takes
// little memory; one mark per post would take as much memory as its height. Several threads may set different rows at
// once.
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
  // Appends the columns up to `past_last`, exclusive: to the row's last run if that has the same mark, else as a new
  // run.
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

// Grid of posts that is too large for a mark per post.
struct PostGridRows {
  UninitialisedVector<float> heights;  // as in Posts
  SourceRows sources;
  std::vector<SourceIndex> replaced{};
};

// Longest distance, in posts, of the valid posts on two opposite sides between which no-data is interpolated. At
// SLDEM2013's 4096 px/deg it is 240 m, which closes gaps of stereo matching in small shadows and leaves real gaps open.
inline constexpr int kFillReach = 32;

}  // namespace selenograph::dem
