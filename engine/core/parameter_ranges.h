#pragma once

#include "engine/core/parameters.h"

#include <cmath>
#include <string_view>

namespace ars {

/// InvalidArgument at `place` naming the first parameter of the table that is outside its range, or not a number. A
/// float that was set to a bound may lie a rounding (1e-6 of it) beyond it.
template <typename Params>
Status checkRanges(const ParameterTable<Params>& table, const Params& params, std::string_view place) {
    for (const ParameterInfo& info : table.infos()) {
        ARS_TRY(ParameterValue value, table.get(params, info.name));
        double* number = std::get_if<double>(&value);
        for (const double bound : {info.range.minimum, info.range.maximum}) {
            if (number && std::abs(*number - bound) <= 1e-6 * std::abs(bound)) *number = bound;
        }
        if (auto checked = checkParameter(info, std::move(value)); !checked) {
            return atPlace(std::move(checked).error(), place);
        }
    }
    return {};
}

} // namespace ars
