#include "engine/occlusion/direction_grid.h"

#include <cmath>

namespace ars {

DirectionGrid latLongDirections(int rows, int columns) {
    DirectionGrid grid;
    grid.rows = rows;
    grid.columns = columns;
    const double dTheta = 3.14159265358979323846 / rows, dPhi = 6.28318530717958647692 / columns;
    for (int i = 0; i < rows; ++i) {
        const double theta = (i + 0.5) * dTheta;
        const double solidAngle = (std::cos(i * dTheta) - std::cos((i + 1) * dTheta)) * dPhi;
        for (int j = 0; j < columns; ++j) {
            const double phi = (j + 0.5) * dPhi;
            grid.directions.emplace_back(static_cast<float>(std::sin(theta) * std::cos(phi)),
                                         static_cast<float>(std::cos(theta)),
                                         static_cast<float>(std::sin(theta) * std::sin(phi)));
            grid.solidAnglesSr.push_back(static_cast<float>(solidAngle));
        }
    }
    return grid;
}

} // namespace ars
