// What `verify accuracy` leaves behind: the sweep's rows as CSV and Markdown, and as a picture.
#pragma once

#include <string>
#include <vector>

#include "api/canvas.h"
#include "engine/verify/accuracy_sweep.h"

namespace selenograph::api {

// A header line, then a line per row; errors in the units that the column's name ends in, shares as fractions.
std::string accuracy_csv(const std::vector<engine::SweepRow>& rows);

// A table per scene. `machine`: where the times were measured.
std::string accuracy_markdown(const std::vector<engine::SweepRow>& rows,
                              const std::vector<engine::AccuracyScene>& scenes, const std::string& machine);

// Error against time, one curve per scene; rows that no other of their scene beats in both are drawn filled (the Pareto
// front). Errors of zero lie on the axis.
Canvas accuracy_plot(const std::vector<engine::SweepRow>& rows, const std::string& machine);

// Of rows of one scene: true where no other row is at most as slow and strictly truer, or as true and strictly faster.
std::vector<bool> pareto_front(const std::vector<double>& times, const std::vector<double>& errors);

}  // namespace selenograph::api
