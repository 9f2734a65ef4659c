// Tables of an answer's members (api/schema/answers.h). A row is a.add(name in JSON, JSON Schema, function that returns
// the value, condition); a member without a condition is always written.
#include "api/answers/crater_answer.h"

#include <cmath>

#include "api/json/ranges.h"
#include "api/requests/features_json.h"

namespace selenograph::api {
namespace {

// Returns [column, row] of a point in the image, pixels.
OrderedJson point_json(const engine::RimPoint& p) { return {thousandths(p.x_px), thousandths(p.y_px)}; }

OrderedJson rim_json(const std::vector<engine::RimPoint>& outline) {
  OrderedJson points = OrderedJson::array();
  for (const engine::RimPoint& p : outline) points.push_back(point_json(p));
  return points;
}

OrderedJson ellipse_json(const engine::RimEllipse& e) {
  return {{"center_px", point_json(e.centre)},
          {"semi_axes_px", {thousandths(e.semi_major_px), thousandths(e.semi_minor_px)}},
          {"angle_deg", thousandths(e.angle_deg)}};
}

void add_image_members(Answer<engine::CraterRim>& a) {
  using namespace schema;
  using engine::CraterRim;
  const OrderedJson point = list(number(kAnyNumber, ""), 2, "column and row, as x_px and y_px elsewhere");
  a.add("rim_px",
        array(point,
              "the rim, a closed polygon, clockwise as seen from above from the north; parts may lie "
              "outside the image. Rounded to 0.001"),
        [](const CraterRim& rim) { return rim_json(rim.outline); });
  a.add("rim_visible", number(kUnitInterval, "share of the rim that is in the image and not hidden"),
        [](const CraterRim& rim) { return rim.rim_visible; });
  a.add("rim_ellipse",
        object("the ellipse with the mean and the covariance of the polygon's corners",
               {{"center_px", point},
                {"semi_axes_px", list(number(kAnyNumber, ""), 2, "the longer one first")},
                {"angle_deg", number({-90, 90}, "from the x axis to the longer axis, toward y")}},
               {"center_px", "semi_axes_px", "angle_deg"}),
        [](const CraterRim& rim) { return ellipse_json(engine::ellipse_of(rim.outline)); });
  a.add("center_px", with_keyword(point, "type", {"array", "null"}),
        [](const CraterRim& rim) { return std::isnan(rim.centre.x_px) ? OrderedJson() : point_json(rim.centre); });
  a.add("center_visible", boolean("whether the middle of its floor is in the image and not hidden"),
        [](const CraterRim& rim) { return rim.centre_visible; });
}

}  // namespace

double thousandths(double x) { return std::round(x * 1000) / 1000; }

const Answer<engine::CraterRim>& crater_answer() {
  static const auto answer = make_answer<engine::CraterRim>(
      "A crater that the frame shows: its members in POST /v1/features, and its place in the image.",
      [](Answer<engine::CraterRim>& a) {
        a.add("id", schema::text("the same in every answer"),
              [](const engine::CraterRim& rim) { return id_text(rim.feature.crater.id); });
        for (const auto& column : crater_columns())
          a.add(column.name.data(), schema::number(kAnyNumber, column.meaning),
                [value = column.value](const engine::CraterRim& rim) { return value(rim.feature); });
        add_image_members(a);
        a.describe("mask_id", schema::integer(0, 65535,
                                              "with `labels`: its pixels' value in `crater_mask`, except where a "
                                              "smaller crater lies in it; 0: nothing of it is in the image"));
      });
  return answer;
}

}  // namespace selenograph::api
