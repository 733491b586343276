#pragma once

#include <glm/glm.hpp>

#include <vector>

namespace ars {

/// A grid of directions over the sphere, y up, with the solid angle of every cell.
struct DirectionGrid {
    int rows = 0;
    int columns = 0;
    std::vector<glm::vec3> directions; ///< (rows * columns) unit, cell centres, row 0 at +y
    std::vector<float> solidAnglesSr;  ///< (rows * columns) exact: (cos t0 - cos t1) * 2 pi / columns
};

/// rows x columns lat-long cells. Both at least 1.
DirectionGrid latLongDirections(int rows, int columns);

} // namespace ars
