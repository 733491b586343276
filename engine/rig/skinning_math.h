#pragma once

#include "engine/core/host_device.h"

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>

#include <cmath>
#include <cstdint>

namespace ars {

/// The three upper rows of a 4x4 matrix: p -> rows . [p; 1]. Twelve numbers, so that a blend is three 4-wide
/// multiply-adds for each influence.
template <typename T>
struct Affine {
    glm::vec<4, T> row[3];
};

/// From a column-vector glm matrix; its last row is (0,0,0,1) for every joint matrix.
template <typename T, typename S>
ARS_HD Affine<T> affineFrom(const glm::mat<4, 4, S>& m) {
    Affine<T> a;
    for (int r = 0; r < 3; ++r) a.row[r] = glm::vec<4, T>(T(m[0][r]), T(m[1][r]), T(m[2][r]), T(m[3][r]));
    return a;
}

/// sum_j w_j A_j over `count` influences of one point (avatar reference 5.5).
template <typename T>
ARS_HD Affine<T> blendAffine(const Affine<T>* matrices, const std::uint16_t* joints, const T* weights, int count) {
    Affine<T> blend;
    const Affine<T>& first = matrices[joints[0]];
    for (int r = 0; r < 3; ++r) blend.row[r] = weights[0] * first.row[r];
    for (int k = 1; k < count; ++k) {
        const Affine<T>& a = matrices[joints[k]];
        const T w = weights[k];
        for (int r = 0; r < 3; ++r) blend.row[r] += w * a.row[r];
    }
    return blend;
}

template <typename T>
ARS_HD glm::vec<3, T> transformPoint(const Affine<T>& a, const glm::vec<3, T>& p) {
    return {a.row[0].x * p.x + a.row[0].y * p.y + a.row[0].z * p.z + a.row[0].w,
            a.row[1].x * p.x + a.row[1].y * p.y + a.row[1].z * p.z + a.row[1].w,
            a.row[2].x * p.x + a.row[2].y * p.y + a.row[2].z * p.z + a.row[2].w};
}

/// 4x4 symmetric matrix K of Davenport's q-method: q^T K q = trace(R(q)^T M) for a unit quaternion q = (w,x,y,z).
template <typename T>
struct RotationForm {
    T k[4][4];
};

template <typename T>
ARS_HD RotationForm<T> rotationForm(const T (&m)[3][3]) {
    RotationForm<T> f;
    f.k[0][0] = m[0][0] + m[1][1] + m[2][2];
    f.k[1][1] = m[0][0] - m[1][1] - m[2][2];
    f.k[2][2] = m[1][1] - m[0][0] - m[2][2];
    f.k[3][3] = m[2][2] - m[0][0] - m[1][1];
    f.k[0][1] = f.k[1][0] = m[2][1] - m[1][2];
    f.k[0][2] = f.k[2][0] = m[0][2] - m[2][0];
    f.k[0][3] = f.k[3][0] = m[1][0] - m[0][1];
    f.k[1][2] = f.k[2][1] = m[0][1] + m[1][0];
    f.k[1][3] = f.k[3][1] = m[0][2] + m[2][0];
    f.k[2][3] = f.k[3][2] = m[1][2] + m[2][1];
    return f;
}

/// Eigenvector of the largest eigenvalue by cyclic Jacobi turns: slow, and never fails, whatever the spectrum.
template <typename T>
ARS_HD glm::qua<T> dominantRotationJacobi(RotationForm<T> f) {
    T v[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
    for (int sweep = 0; sweep < 12; ++sweep) {
        T off = T(0);
        for (int p = 0; p < 3; ++p) {
            for (int q = p + 1; q < 4; ++q) off += f.k[p][q] * f.k[p][q];
        }
        if (!(off > T(1e-30))) break;
        for (int p = 0; p < 3; ++p) {
            for (int q = p + 1; q < 4; ++q) {
                if (f.k[p][q] == T(0)) continue;
                const T theta = (f.k[q][q] - f.k[p][p]) / (T(2) * f.k[p][q]);
                const T t = (theta < T(0) ? T(-1) : T(1)) / (std::fabs(theta) + std::sqrt(theta * theta + T(1)));
                const T c = T(1) / std::sqrt(t * t + T(1));
                const T s = t * c;
                for (int i = 0; i < 4; ++i) {
                    const T a = f.k[i][p], b = f.k[i][q];
                    f.k[i][p] = c * a - s * b;
                    f.k[i][q] = s * a + c * b;
                }
                for (int i = 0; i < 4; ++i) {
                    const T a = f.k[p][i], b = f.k[q][i];
                    f.k[p][i] = c * a - s * b;
                    f.k[q][i] = s * a + c * b;
                    const T x = v[i][p], y = v[i][q];
                    v[i][p] = c * x - s * y;
                    v[i][q] = s * x + c * y;
                }
            }
        }
    }
    int best = 0;
    for (int i = 1; i < 4; ++i) {
        if (f.k[i][i] > f.k[best][best]) best = i;
    }
    const T sign = v[0][best] < T(0) ? T(-1) : T(1);
    return glm::normalize(glm::qua<T>(sign * v[0][best], sign * v[1][best], sign * v[2][best], sign * v[3][best]));
}

/// Cofactor of element (i,j) of a symmetric 4x4 matrix, i.e. the signed determinant of what is left.
template <typename T>
ARS_HD T cofactor(const T (&a)[4][4], int i, int j) {
    const int r0 = i == 0 ? 1 : 0, r1 = i <= 1 ? 2 : 1, r2 = i <= 2 ? 3 : 2;
    const int c0 = j == 0 ? 1 : 0, c1 = j <= 1 ? 2 : 1, c2 = j <= 2 ? 3 : 2;
    const T minor = a[r0][c0] * (a[r1][c1] * a[r2][c2] - a[r1][c2] * a[r2][c1]) -
                    a[r0][c1] * (a[r1][c0] * a[r2][c2] - a[r1][c2] * a[r2][c0]) +
                    a[r0][c2] * (a[r1][c0] * a[r2][c1] - a[r1][c1] * a[r2][c0]);
    return (i + j) % 2 == 0 ? minor : -minor;
}

/// Eigenvector of K to its simple eigenvalue `lambda`: every column of adj(K - lambda) is a multiple of it; the longest
/// is taken.
template <typename T>
ARS_HD glm::qua<T> eigenRotation(RotationForm<T> f, T lambda) {
    for (int i = 0; i < 4; ++i) f.k[i][i] -= lambda;
    T diagonal[4];
    int best = 0;
    for (int i = 0; i < 4; ++i) {
        diagonal[i] = cofactor(f.k, i, i);
        if (std::fabs(diagonal[i]) > std::fabs(diagonal[best])) best = i;
    }
    T q[4];
    for (int i = 0; i < 4; ++i) q[i] = i == best ? diagonal[best] : cofactor(f.k, i, best);
    const T sign = q[0] < T(0) ? T(-1) : T(1);
    return glm::normalize(glm::qua<T>(sign * q[0], sign * q[1], sign * q[2], sign * q[3]));
}

/// The rotation nearest to the linear part M of a blend in the Frobenius norm: argmax over SO(3) of trace(R^T M), which
/// is the rotation of the polar decomposition M = R S where det M > 0 and the best proper rotation where M reflects or
/// is singular. Unlike Gram-Schmidt it prefers no axis.
///
/// The largest eigenvalue of K is found by Newton's method on its quartic
///     l^4 - 2 |M|^2 l^2 - 8 det(M) l + |M|^4 - 4 |cof M|^2,
/// from the bound sqrt(3) |M| downwards, the rotation from the adjugate. Where that eigenvalue is nearly double (M
/// close to a reflection or to rank one: blends of opposite turns) it goes on with Jacobi turns instead. A zero or
/// non-finite matrix gives the identity. The result is unit length with w >= 0.
template <typename T>
ARS_HD glm::qua<T> polarRotation(const Affine<T>& a) {
    T norm2 = T(0);
    for (int r = 0; r < 3; ++r) norm2 += a.row[r].x * a.row[r].x + a.row[r].y * a.row[r].y + a.row[r].z * a.row[r].z;
    if (!(norm2 > T(1e-30)) || !(norm2 < T(1e30))) return glm::qua<T>(T(1), T(0), T(0), T(0));
    const T scale = T(1) / std::sqrt(norm2);
    T m[3][3];
    for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) m[r][c] = scale * a.row[r][c];
    }

    T cofactors[3][3];
    T cofactor2 = T(0);
    for (int r = 0; r < 3; ++r) {
        const int r1 = (r + 1) % 3, r2 = (r + 2) % 3;
        for (int c = 0; c < 3; ++c) {
            const int c1 = (c + 1) % 3, c2 = (c + 2) % 3;
            cofactors[r][c] = m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1];
            cofactor2 += cofactors[r][c] * cofactors[r][c];
        }
    }
    const T det = m[0][0] * cofactors[0][0] + m[0][1] * cofactors[0][1] + m[0][2] * cofactors[0][2];
    const T constant = T(1) - T(4) * cofactor2; // |M| is 1 by now
    T lambda = T(1.7320508075688772);
    T slope = T(0);
    for (int i = 0; i < 24; ++i) {
        const T lambda2 = lambda * lambda;
        slope = T(4) * lambda * (lambda2 - T(1)) - T(8) * det;
        if (!(slope > T(0.05))) break;
        const T step = ((lambda2 - T(2)) * lambda2 - T(8) * det * lambda + constant) / slope;
        lambda -= step;
        if (!(std::fabs(step) > T(4) * (sizeof(T) == 4 ? T(6e-8) : T(1e-16)))) break;
    }
    const RotationForm<T> form = rotationForm(m);
    // The slope is the product of the distances to the other eigenvalues (12.3 for a rotation): small means no gap.
    return slope > T(0.05) ? eigenRotation(form, lambda) : dominantRotationJacobi(form);
}

/// R(q) n, unit length for unit n; a zero normal stays zero.
template <typename T>
ARS_HD glm::vec<3, T> rotateNormal(const glm::qua<T>& q, const glm::vec<3, T>& n) {
    const glm::vec<3, T> v(q.x, q.y, q.z);
    const glm::vec<3, T> t = T(2) * glm::cross(v, n);
    const glm::vec<3, T> turned = n + q.w * t + glm::cross(v, t);
    const T length2 = glm::dot(turned, turned);
    return length2 > T(0) ? turned * (T(1) / std::sqrt(length2)) : turned;
}

} // namespace ars
