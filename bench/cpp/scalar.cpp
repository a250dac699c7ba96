// Other libraries for lg-bench scalar: the gradient of a trajectory with respect to its start. Prints one
// JSON object with a row for each available way. ../compare defines HAVE_ADOLC, HAVE_ADEPT and HAVE_CPPAD if
// the headers of these libraries are installed.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "pendulum.hpp"
#include "tape.hpp"

#ifdef HAVE_ADOLC
#include <adolc/adolc.h>
#endif
#ifdef HAVE_ADEPT
#include <adept.h>
#endif
#ifdef HAVE_CPPAD
#include <cppad/cppad.hpp>
#endif

static double seconds() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

static bool first = true;
static volatile double start[4] = {start_state[0], start_state[1], start_state[2],
                                   start_state[3]}; // volatile: not folded

// Warms up, then prints medians over samples of many calls each. `gradient` is printed too, so that the ways
// can be compared.
template <class Call> static void measure(const char *name, int repeats, const double *gradient, Call call) {
    double begin = seconds(), one = 0;
    for (int calls = 1; seconds() - begin < 0.1; calls *= 2) {
        const double t = seconds();
        for (int i = 0; i < calls; i++) call();
        one = (seconds() - t) / calls;
    }
    const int inner = std::max(1, static_cast<int>(4e-4 / one) + 1);
    std::vector<double> us;
    for (int r = 0; r < repeats; r++) {
        const double t = seconds();
        for (int i = 0; i < inner; i++) call();
        us.push_back((seconds() - t) * 1e6 / inner);
    }
    std::sort(us.begin(), us.end());
    std::printf("%s{\"name\": \"%s\", \"median_us\": %.6g, \"min_us\": %.6g, \"samples\": %d, \"inner\": %d, "
                "\"gradient\": "
                "[%.17g, %.17g, %.17g, %.17g]}",
                first ? "" : ", ", name, us[us.size() / 2], us[0], repeats, inner, gradient[0], gradient[1],
                gradient[2], gradient[3]);
    first = false;
}

int main(int argc, char **argv) {
    const int repeats = argc > 1 ? std::max(1, std::atoi(argv[1])) : 101;
    double g[4], sink = 0;
    std::printf("{\"peer\": \"C++\", \"case\": \"scalar\", \"rows\": [");

    for (double &x : g) x = 0;
    measure("forward only", repeats, g, [&] {
        const double y0[4] = {start[0], start[1], start[2], start[3]};
        sink += trajectory(y0);
    });

    measure("minimal tape", repeats, g, [&] {
        tape::clear();
        tape::Real y0[4];
        for (int j = 0; j < 4; j++) y0[j] = tape::Real(start[j]);
        const tape::Real y = trajectory(y0);
        tape::reverse(y.i);
        for (int j = 0; j < 4; j++) g[j] = tape::adjoints[y0[j].i];
    });

#ifdef HAVE_ADEPT
    {
        adept::Stack stack;
        measure("Adept", repeats, g, [&] {
            adept::adouble y0[4];
            for (int j = 0; j < 4; j++) y0[j] = start_state[j];
            stack.new_recording();
            adept::adouble y = trajectory(y0);
            y.set_gradient(1.0);
            stack.compute_adjoint();
            for (int j = 0; j < 4; j++) g[j] = y0[j].get_gradient();
        });
    }
#endif

#ifdef HAVE_ADOLC
    auto record = [&] {
        trace_on(1);
        adouble y0[4], y;
        double value;
        for (int j = 0; j < 4; j++) y0[j] <<= start_state[j];
        y = trajectory(y0);
        y >>= value;
        trace_off();
        sink += value;
    };
    record();
    measure("ADOL-C replay", repeats, g, [&] { gradient(1, 4, start_state, g); });
    measure("ADOL-C record and replay", repeats, g, [&] {
        record();
        gradient(1, 4, start_state, g);
    });
#endif

#ifdef HAVE_CPPAD
    {
        using AD = CppAD::AD<double>;
        std::vector<AD> y0(start_state, start_state + 4), y(1);
        CppAD::Independent(y0);
        y[0] = trajectory(y0.data());
        CppAD::ADFun<double> f(y0, y);
        const std::vector<double> x(start_state, start_state + 4), w(1, 1.0);
        measure("CppAD replay", repeats, g, [&] {
            sink += f.Forward(0, x)[0];
            const std::vector<double> d = f.Reverse(1, w);
            for (int j = 0; j < 4; j++) g[j] = d[static_cast<std::size_t>(j)];
        });
    }
#endif
    std::printf("], \"sink\": %.17g}\n", sink);
    return 0;
}
