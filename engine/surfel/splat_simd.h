#pragma once

#include <cstddef>
#include <cstdint>

/// Sixteen floats at once, in the registers of one instruction set, for splat_pixel_math.h. Each type exists only in
/// files that are compiled for it, and everything that such a file instantiates carries the type in its name: no
/// function can be taken for one of another instruction set at link time.
#if defined(__AVX512F__) && defined(__AVX512DQ__) && defined(__AVX512BW__) && defined(__AVX512VL__)
#define ARS_SIMD_AVX512 1
#include <immintrin.h>
#elif defined(__AVX2__) && defined(__FMA__)
#define ARS_SIMD_AVX2 1
#include <immintrin.h>
#endif

namespace ars::cpu {

inline constexpr int kLanes = 16;

// 2^f for |f| <= 1/2: the polynomial of degree 5 whose largest relative error is least, 1.9e-7 in float.
inline constexpr float kExp2C1 = 0.693147004f, kExp2C2 = 0.240222424f, kExp2C3 = 0.0555073358f,
                       kExp2C4 = 0.00967151299f, kExp2C5 = 0.00132647273f;

#if ARS_SIMD_AVX512

struct Avx512Mask {
    __mmask16 m;

    std::uint32_t bits() const { return m; }
    bool none() const { return m == 0; }
    static Avx512Mask fromBits(std::uint32_t bits) { return {static_cast<__mmask16>(bits)}; }
    friend Avx512Mask both(Avx512Mask a, Avx512Mask b) { return {static_cast<__mmask16>(a.m & b.m)}; }
    friend Avx512Mask either(Avx512Mask a, Avx512Mask b) { return {static_cast<__mmask16>(a.m | b.m)}; }
    friend Avx512Mask butNot(Avx512Mask a, Avx512Mask b) { return {static_cast<__mmask16>(a.m & ~b.m)}; }
};

struct Avx512Float {
    using Mask = Avx512Mask;
    static constexpr int kGroup = 16; ///< channels whose sums stay in registers

    __m512 v;

    Avx512Float() = default;
    explicit Avx512Float(float x) : v(_mm512_set1_ps(x)) {}
    explicit Avx512Float(__m512 x) : v(x) {}
    static Avx512Float load(const float* from) { return Avx512Float(_mm512_load_ps(from)); }
    void store(float* to) const { _mm512_store_ps(to, v); }
    /// Past the caches; streamEnd() before another thread may read.
    void stream(float* to) const { _mm512_stream_ps(to, v); }
    static void streamEnd() { _mm_sfence(); }

    friend Avx512Float operator+(Avx512Float a, Avx512Float b) { return Avx512Float(_mm512_add_ps(a.v, b.v)); }
    friend Avx512Float operator-(Avx512Float a, Avx512Float b) { return Avx512Float(_mm512_sub_ps(a.v, b.v)); }
    friend Avx512Float operator*(Avx512Float a, Avx512Float b) { return Avx512Float(_mm512_mul_ps(a.v, b.v)); }
    friend Avx512Float operator/(Avx512Float a, Avx512Float b) { return Avx512Float(_mm512_div_ps(a.v, b.v)); }
    friend Avx512Mask operator<(Avx512Float a, Avx512Float b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_LT_OQ)}; }
    friend Avx512Mask operator<=(Avx512Float a, Avx512Float b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_LE_OQ)}; }
    friend Avx512Mask operator>=(Avx512Float a, Avx512Float b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_GE_OQ)}; }
    friend Avx512Float mulAdd(Avx512Float a, Avx512Float b, Avx512Float c) {
        return Avx512Float(_mm512_fmadd_ps(a.v, b.v, c.v));
    }
    friend Avx512Float minOf(Avx512Float a, Avx512Float b) { return Avx512Float(_mm512_min_ps(a.v, b.v)); }
    friend Avx512Float maxOf(Avx512Float a, Avx512Float b) { return Avx512Float(_mm512_max_ps(a.v, b.v)); }
    friend Avx512Float select(Avx512Mask m, Avx512Float yes, Avx512Float no) {
        return Avx512Float(_mm512_mask_blend_ps(m.m, no.v, yes.v));
    }
    friend Avx512Float sqrtOf(Avx512Float a) { return Avx512Float(_mm512_sqrt_ps(a.v)); }
    friend Avx512Float exp2Of(Avx512Float x) {
        const __m512 whole = _mm512_roundscale_ps(x.v, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
        const __m512 f = _mm512_sub_ps(x.v, whole);
        __m512 p = _mm512_fmadd_ps(_mm512_set1_ps(kExp2C5), f, _mm512_set1_ps(kExp2C4));
        p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(kExp2C3));
        p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(kExp2C2));
        p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(kExp2C1));
        p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(1.0f));
        return Avx512Float(_mm512_scalef_ps(p, whole));
    }
};
using NativeFloat = Avx512Float;

#elif ARS_SIMD_AVX2

struct Avx2Mask {
    __m256 low, high;

    std::uint32_t bits() const {
        return static_cast<std::uint32_t>(_mm256_movemask_ps(low)) |
               static_cast<std::uint32_t>(_mm256_movemask_ps(high)) << 8;
    }
    bool none() const {
        const __m256 any = _mm256_or_ps(low, high);
        return _mm256_testz_ps(any, any) != 0;
    }
    static Avx2Mask fromBits(std::uint32_t bits) {
        const __m256i pick = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        const __m256i all = _mm256_set1_epi32(static_cast<int>(bits));
        const __m256i below = _mm256_cmpeq_epi32(_mm256_and_si256(all, pick), pick);
        const __m256i shifted = _mm256_srli_epi32(all, 8);
        const __m256i above = _mm256_cmpeq_epi32(_mm256_and_si256(shifted, pick), pick);
        return {_mm256_castsi256_ps(below), _mm256_castsi256_ps(above)};
    }
    friend Avx2Mask both(Avx2Mask a, Avx2Mask b) {
        return {_mm256_and_ps(a.low, b.low), _mm256_and_ps(a.high, b.high)};
    }
    friend Avx2Mask either(Avx2Mask a, Avx2Mask b) {
        return {_mm256_or_ps(a.low, b.low), _mm256_or_ps(a.high, b.high)};
    }
    friend Avx2Mask butNot(Avx2Mask a, Avx2Mask b) {
        return {_mm256_andnot_ps(b.low, a.low), _mm256_andnot_ps(b.high, a.high)};
    }
};

struct Avx2Float {
    using Mask = Avx2Mask;
    static constexpr int kGroup = 4;

    __m256 low, high;

    Avx2Float() = default;
    explicit Avx2Float(float x) : low(_mm256_set1_ps(x)), high(low) {}
    Avx2Float(__m256 a, __m256 b) : low(a), high(b) {}
    static Avx2Float load(const float* from) { return {_mm256_load_ps(from), _mm256_load_ps(from + 8)}; }
    void store(float* to) const {
        _mm256_store_ps(to, low);
        _mm256_store_ps(to + 8, high);
    }
    /// Past the caches; streamEnd() before another thread may read.
    void stream(float* to) const {
        _mm256_stream_ps(to, low);
        _mm256_stream_ps(to + 8, high);
    }
    static void streamEnd() { _mm_sfence(); }

    friend Avx2Float operator+(Avx2Float a, Avx2Float b) {
        return {_mm256_add_ps(a.low, b.low), _mm256_add_ps(a.high, b.high)};
    }
    friend Avx2Float operator-(Avx2Float a, Avx2Float b) {
        return {_mm256_sub_ps(a.low, b.low), _mm256_sub_ps(a.high, b.high)};
    }
    friend Avx2Float operator*(Avx2Float a, Avx2Float b) {
        return {_mm256_mul_ps(a.low, b.low), _mm256_mul_ps(a.high, b.high)};
    }
    friend Avx2Float operator/(Avx2Float a, Avx2Float b) {
        return {_mm256_div_ps(a.low, b.low), _mm256_div_ps(a.high, b.high)};
    }
    friend Avx2Mask operator<(Avx2Float a, Avx2Float b) {
        return {_mm256_cmp_ps(a.low, b.low, _CMP_LT_OQ), _mm256_cmp_ps(a.high, b.high, _CMP_LT_OQ)};
    }
    friend Avx2Mask operator<=(Avx2Float a, Avx2Float b) {
        return {_mm256_cmp_ps(a.low, b.low, _CMP_LE_OQ), _mm256_cmp_ps(a.high, b.high, _CMP_LE_OQ)};
    }
    friend Avx2Mask operator>=(Avx2Float a, Avx2Float b) {
        return {_mm256_cmp_ps(a.low, b.low, _CMP_GE_OQ), _mm256_cmp_ps(a.high, b.high, _CMP_GE_OQ)};
    }
    friend Avx2Float mulAdd(Avx2Float a, Avx2Float b, Avx2Float c) {
        return {_mm256_fmadd_ps(a.low, b.low, c.low), _mm256_fmadd_ps(a.high, b.high, c.high)};
    }
    friend Avx2Float minOf(Avx2Float a, Avx2Float b) {
        return {_mm256_min_ps(a.low, b.low), _mm256_min_ps(a.high, b.high)};
    }
    friend Avx2Float maxOf(Avx2Float a, Avx2Float b) {
        return {_mm256_max_ps(a.low, b.low), _mm256_max_ps(a.high, b.high)};
    }
    friend Avx2Float select(Avx2Mask m, Avx2Float yes, Avx2Float no) {
        return {_mm256_blendv_ps(no.low, yes.low, m.low), _mm256_blendv_ps(no.high, yes.high, m.high)};
    }
    friend Avx2Float sqrtOf(Avx2Float a) { return {_mm256_sqrt_ps(a.low), _mm256_sqrt_ps(a.high)}; }
    friend Avx2Float exp2Of(Avx2Float x) { return {exp2Half(x.low), exp2Half(x.high)}; }

private:
    static __m256 exp2Half(__m256 x) {
        const __m256 whole = _mm256_round_ps(x, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
        const __m256 f = _mm256_sub_ps(x, whole);
        __m256 p = _mm256_fmadd_ps(_mm256_set1_ps(kExp2C5), f, _mm256_set1_ps(kExp2C4));
        p = _mm256_fmadd_ps(p, f, _mm256_set1_ps(kExp2C3));
        p = _mm256_fmadd_ps(p, f, _mm256_set1_ps(kExp2C2));
        p = _mm256_fmadd_ps(p, f, _mm256_set1_ps(kExp2C1));
        p = _mm256_fmadd_ps(p, f, _mm256_set1_ps(1.0f));
        const __m256i shift = _mm256_slli_epi32(_mm256_cvtps_epi32(whole), 23);
        return _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(p), shift));
    }
};
using NativeFloat = Avx2Float;

#else

/// Four registers of four, with the compilers' own vectors: any processor, no intrinsics.
using Float4 = float __attribute__((vector_size(16)));
using Int4 = std::int32_t __attribute__((vector_size(16)));
using Float4InMemory = float __attribute__((vector_size(16), may_alias));
inline constexpr int kQuarters = 4;

struct PortableMask {
    Int4 q[kQuarters];

    std::uint32_t bits() const {
        std::uint32_t result = 0;
        for (int i = 0; i < kQuarters; ++i) {
            for (int k = 0; k < 4; ++k) result |= static_cast<std::uint32_t>(q[i][k] & 1) << (4 * i + k);
        }
        return result;
    }
    bool none() const {
        const Int4 any = (q[0] | q[1]) | (q[2] | q[3]);
        return (any[0] | any[1] | any[2] | any[3]) == 0;
    }
    static PortableMask fromBits(std::uint32_t bits) {
        PortableMask result;
        for (int i = 0; i < kQuarters; ++i) {
            for (int k = 0; k < 4; ++k) result.q[i][k] = (bits >> (4 * i + k)) & 1u ? -1 : 0;
        }
        return result;
    }
    template <typename F>
    static PortableMask each(F f) {
        PortableMask result;
        for (int i = 0; i < kQuarters; ++i) result.q[i] = f(i);
        return result;
    }
    friend PortableMask both(const PortableMask& a, const PortableMask& b) {
        return each([&](int i) { return a.q[i] & b.q[i]; });
    }
    friend PortableMask either(const PortableMask& a, const PortableMask& b) {
        return each([&](int i) { return a.q[i] | b.q[i]; });
    }
    friend PortableMask butNot(const PortableMask& a, const PortableMask& b) {
        return each([&](int i) { return a.q[i] & ~b.q[i]; });
    }
};

struct PortableFloat {
    using Mask = PortableMask;
    static constexpr int kGroup = 2;

    Float4 q[kQuarters];

    PortableFloat() = default;
    explicit PortableFloat(float x) {
        for (Float4& part : q) part = Float4{x, x, x, x};
    }
    template <typename F>
    static PortableFloat each(F f) {
        PortableFloat result;
        for (int i = 0; i < kQuarters; ++i) result.q[i] = f(i);
        return result;
    }
    static PortableFloat load(const float* from) {
        return each([&](int i) { return *reinterpret_cast<const Float4InMemory*>(from + 4 * i); });
    }
    void store(float* to) const {
        for (int i = 0; i < kQuarters; ++i) *reinterpret_cast<Float4InMemory*>(to + 4 * i) = q[i];
    }
    void stream(float* to) const { store(to); }
    static void streamEnd() {}
    static Float4 pick(Int4 m, Float4 yes, Float4 no) {
        return reinterpret_cast<Float4>((reinterpret_cast<Int4>(yes) & m) | (reinterpret_cast<Int4>(no) & ~m));
    }

    friend PortableFloat operator+(const PortableFloat& a, const PortableFloat& b) {
        return each([&](int i) { return a.q[i] + b.q[i]; });
    }
    friend PortableFloat operator-(const PortableFloat& a, const PortableFloat& b) {
        return each([&](int i) { return a.q[i] - b.q[i]; });
    }
    friend PortableFloat operator*(const PortableFloat& a, const PortableFloat& b) {
        return each([&](int i) { return a.q[i] * b.q[i]; });
    }
    friend PortableFloat operator/(const PortableFloat& a, const PortableFloat& b) {
        return each([&](int i) { return a.q[i] / b.q[i]; });
    }
    friend PortableMask operator<(const PortableFloat& a, const PortableFloat& b) {
        return PortableMask::each([&](int i) { return a.q[i] < b.q[i]; });
    }
    friend PortableMask operator<=(const PortableFloat& a, const PortableFloat& b) {
        return PortableMask::each([&](int i) { return a.q[i] <= b.q[i]; });
    }
    friend PortableMask operator>=(const PortableFloat& a, const PortableFloat& b) {
        return PortableMask::each([&](int i) { return a.q[i] >= b.q[i]; });
    }
    friend PortableFloat mulAdd(const PortableFloat& a, const PortableFloat& b, const PortableFloat& c) {
        return each([&](int i) { return a.q[i] * b.q[i] + c.q[i]; });
    }
    friend PortableFloat minOf(const PortableFloat& a, const PortableFloat& b) {
        return each([&](int i) { return pick(a.q[i] < b.q[i], a.q[i], b.q[i]); });
    }
    friend PortableFloat maxOf(const PortableFloat& a, const PortableFloat& b) {
        return each([&](int i) { return pick(a.q[i] > b.q[i], a.q[i], b.q[i]); });
    }
    friend PortableFloat select(const PortableMask& m, const PortableFloat& yes, const PortableFloat& no) {
        return each([&](int i) { return pick(m.q[i], yes.q[i], no.q[i]); });
    }
    friend PortableFloat sqrtOf(const PortableFloat& a) {
        PortableFloat result;
        for (int i = 0; i < kQuarters; ++i) {
            for (int k = 0; k < 4; ++k) result.q[i][k] = __builtin_sqrtf(a.q[i][k]);
        }
        return result;
    }
    friend PortableFloat exp2Of(const PortableFloat& x) {
        return each([&](int i) {
            // Only exponents that blending can use; adding and taking away 1.5 * 2^23 rounds to the nearest integer.
            const Float4 least = {-126.0f, -126.0f, -126.0f, -126.0f}, most = {126.0f, 126.0f, 126.0f, 126.0f};
            const Float4 kept = pick(x.q[i] > least, pick(x.q[i] < most, x.q[i], most), least);
            const Float4 moved = kept + 12582912.0f;
            const Float4 f = kept - (moved - 12582912.0f);
            Float4 p = kExp2C5 * f + kExp2C4;
            p = p * f + kExp2C3;
            p = p * f + kExp2C2;
            p = p * f + kExp2C1;
            p = p * f + 1.0f;
            const Int4 whole = reinterpret_cast<Int4>(moved) - 0x4B400000;
            return reinterpret_cast<Float4>(reinterpret_cast<Int4>(p) + whole * (1 << 23));
        });
    }
};
using NativeFloat = PortableFloat;

#endif

} // namespace ars::cpu
