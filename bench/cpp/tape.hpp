// A minimal operator tape, as a user writes it in an afternoon when a library is too slow. Variables hold
// their values. One array holds at most two partial derivatives per statement; it is recorded anew at each
// call.
#pragma once
#include <cmath>
#include <cstdint>
#include <vector>

namespace tape {

struct Statement {
    std::uint32_t a, b;
    double da, db;
};

// Slot 0 is no statement. Missing arguments point to it, with derivative 0.
constexpr std::uint32_t capacity = 1u << 20;
static std::vector<Statement> statements(capacity);
static std::vector<double> adjoints(capacity);
static std::uint32_t count = 1;
static Statement *const base = statements.data();

inline void clear() { count = 1; }

inline std::uint32_t push(std::uint32_t a, double da, std::uint32_t b, double db) {
    base[count] = {a, b, da, db};
    return count++;
}

// Computes the adjoints of all statements; the adjoint of statement y is 1.
inline void reverse(std::uint32_t y) {
    double *adjoint = adjoints.data();
    for (std::uint32_t i = 0; i < count; i++) adjoint[i] = 0.0;
    adjoint[y] = 1.0;
    for (std::uint32_t i = count; i-- > 1;) {
        const double g = adjoint[i];
        const Statement &s = base[i];
        adjoint[s.a] += g * s.da;
        adjoint[s.b] += g * s.db;
    }
}

struct Real {
    double v;
    std::uint32_t i;
    Real() {}
    explicit Real(double x) : v(x), i(push(0, 0, 0, 0)) {}
    Real(double x, std::uint32_t index) : v(x), i(index) {}
};

inline Real make(double v, const Real &a, double da) { return {v, push(a.i, da, 0, 0)}; }
inline Real make(double v, const Real &a, double da, const Real &b, double db) { return {v, push(a.i, da, b.i, db)}; }
inline Real operator+(const Real &a, const Real &b) { return make(a.v + b.v, a, 1, b, 1); }
inline Real operator-(const Real &a, const Real &b) { return make(a.v - b.v, a, 1, b, -1); }
inline Real operator*(const Real &a, const Real &b) { return make(a.v * b.v, a, b.v, b, a.v); }
inline Real operator-(double a, const Real &b) { return make(a - b.v, b, -1); }
inline Real operator*(double a, const Real &b) { return make(a * b.v, b, a); }
inline Real operator/(double a, const Real &b) {
    const double q = a / b.v;
    return make(q, b, -q / b.v);
}
inline Real operator-(const Real &a) { return make(-a.v, a, -1); }
inline Real sin(const Real &a) { return make(std::sin(a.v), a, std::cos(a.v)); }
inline Real cos(const Real &a) { return make(std::cos(a.v), a, -std::sin(a.v)); }

} // namespace tape
