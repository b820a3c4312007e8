/* Monitors a gripper while it runs: a grasp within 2 s, and never more than 20 N for longer than 50 ms.
 *
 *   cargo build --release -p mishandle-monitor-c
 *   cc -Icrates/monitor-c/include crates/monitor-c/examples/monitor.c target/release/libmishandle_monitor.a -lm -o monitor
 *   cc -Icrates/monitor-c/include crates/monitor-c/examples/monitor.c -Ltarget/release -lmishandle_monitor -o monitor
 */
#include <stdio.h>
#include <stdlib.h>

#include "mishandle_monitor.h"

enum { FORMULAS = 2, SIGNALS = 2 };

static const char *const NAMES[FORMULAS] = {"grasp", "force"};

/* Stops the program if a call failed. */
static void check(MishandleStatus status)
{
    if (status != MISHANDLE_STATUS_OK) {
        fprintf(stderr, "error %d: %s\n", (int)status, mishandle_last_error());
        exit(1);
    }
}

/* The gripper closes for 1 s, and an object slips at 2.5 s. */
static void measure(int step, double sample[SIGNALS])
{
    double seconds = step * 0.01;
    sample[0] = seconds < 1.0 ? 0.0 : 12.0;
    if (seconds >= 2.5 && seconds < 2.6) {
        sample[0] = 26.0;
    }
    sample[1] = seconds < 1.0 ? 0.0 : 1.0;
}

int main(void)
{
    const char *const formulas[FORMULAS] = {
        "eventually[0:2s](grasped >= 1)",
        "always(eventually[0:50ms](`gripper/force` <= 20))",
    };
    const char *const signals[SIGNALS] = {"gripper/force", "grasped"};
    MishandleVerdict before[FORMULAS] = {MISHANDLE_VERDICT_OPEN, MISHANDLE_VERDICT_OPEN};
    MishandleMonitor *monitor = NULL;
    int step;
    size_t formula;

    /* 100 samples per second, for as long as it runs. */
    check(mishandle_monitor_create(formulas, FORMULAS, signals, SIGNALS, 0.01, 0, &monitor));
    for (step = 0; step < 400; step++) {
        double sample[SIGNALS];
        measure(step, sample);
        check(mishandle_monitor_push(monitor, sample, SIGNALS));
        for (formula = 0; formula < FORMULAS; formula++) {
            MishandleVerdict verdict;
            double low, high;
            check(mishandle_monitor_verdict(monitor, formula, &verdict));
            check(mishandle_monitor_bounds(monitor, formula, &low, &high));
            if (verdict != before[formula]) {
                printf("%.2f s: %s is %s, robustness in [%g, %g]\n", step * 0.01, NAMES[formula],
                       verdict == MISHANDLE_VERDICT_SATISFIED ? "satisfied" : "violated", low, high);
                before[formula] = verdict;
            }
        }
    }
    check(mishandle_monitor_reset(monitor));
    mishandle_monitor_destroy(monitor);
    return 0;
}
