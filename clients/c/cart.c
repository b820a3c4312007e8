/* The cart of ../python/cart.py, whose policy Mishandle runs: cc -std=c99 -O2 cart.c -o cart -lm */
#include "mishandle_simulator.h"

static const double dt = 0.05;
static double position, velocity, mass;

static void answer(struct mishandle_question *question) {
    double state[] = {position, velocity};
    mishandle_sample(question, state);
    mishandle_observe(question, state);
}

static void reset(struct mishandle_question *question) {
    position = mishandle_value(question, "position");
    velocity = mishandle_value(question, "velocity");
    mass = mishandle_value(question, "mass");
    answer(question);
}

static void step(struct mishandle_question *question) {
    velocity += dt * question->action[0] / mass;
    position += dt * velocity;
    answer(question);
}

static const struct mishandle_simulator cart = {
    .name = "cart",
    .version = "1.0",
    .control_dt = 0.05,
    .steps = 200,
    .axes = {{.name = "position", .unit = "m", .low = -0.5, .high = 0.5, .kind = "start"},
             {.name = "velocity", .unit = "m/s", .low = -1.0, .high = 1.0, .kind = "start"},
             {.name = "mass", .unit = "kg", .low = 0.5, .high = 2.0, .nominal = 1.0, .kind = "model"}},
    .signals = {{.name = "position", .unit = "m"}, {.name = "velocity", .unit = "m/s"}},
    .formulas = {{"on_rail", "always(position <= 1 and position >= -1)"}},
    .observation = {{.name = "position", .unit = "m"}, {.name = "velocity", .unit = "m/s"}},
    .action = {{.name = "force", .unit = "N"}},
    .action_limit = 1.0,
    .reset = reset,
    .step = step,
};

int main(void) { return mishandle_serve(&cart); }
