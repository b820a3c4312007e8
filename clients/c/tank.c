/* The water tank of ../python/tank.py: cc -std=c99 -O2 tank.c -o tank -lm */
#include "mishandle_simulator.h"

static const double dt = 0.1;
enum { STEPS = 300 };

static void simulate(struct mishandle_question *question) {
    double level = mishandle_value(question, "level");
    double demand = mishandle_value(question, "demand"), lag = mishandle_value(question, "lag");
    double valve = 0.0, integral = 0.0;
    for (int k = 0; k <= STEPS; k++) {
        double signals[] = {level, valve};
        mishandle_sample(question, signals);
        double error = 0.7 - level;
        integral += 0.4 * error * dt; /* without anti-windup: the mistake */
        double command = fmin(1.0, fmax(0.0, error + integral));
        valve += dt / lag * (command - valve);
        level = fmax(0.0, level + dt * (0.12 * valve - demand * sqrt(level)));
    }
}

static const struct mishandle_simulator tank = {
    .name = "tank",
    .version = "1.0",
    .control_dt = 0.1,
    .steps = STEPS,
    .axes = {{.name = "level", .unit = "m", .low = 0.1, .high = 0.9, .nominal = 0.5, .kind = "start"},
             {.name = "demand", .unit = "m²/s", .low = 0.02, .high = 0.1, .nominal = 0.06, .kind = "model"},
             {.name = "lag", .unit = "s", .low = 0.5, .high = 2.0, .nominal = 1.0, .kind = "model"}},
    .signals = {{.name = "level", .unit = "m"}, {.name = "valve"}},
    .formulas = {{"no_overflow", "always(level <= 1)"},
                 {"success", "always[20s:30s](level >= 0.5 and level <= 0.9)"}},
    .simulate = simulate,
};

int main(void) { return mishandle_serve(&tank); }
