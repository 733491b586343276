#pragma once

#include "engine/core/parameters.h"

#include <string_view>

namespace ars {

/// InvalidArgument at `place` naming the first parameter of the table that is outside its range, or not a number.
template <typename Params>
Status checkRanges(const ParameterTable<Params>& table, const Params& params, std::string_view place) {
    for (const ParameterInfo& info : table.infos()) {
        ARS_TRY(ParameterValue value, table.get(params, info.name));
        if (auto checked = checkParameter(info, std::move(value)); !checked) {
            return atPlace(std::move(checked).error(), place);
        }
    }
    return {};
}

} // namespace ars
