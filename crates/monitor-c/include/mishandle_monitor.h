/* Online monitors of signal temporal logic. `cargo xtask monitor --update` writes this file from
 * crates/monitor-c/src/lib.rs.
 *
 * A monitor gets one sample after the other. After each sample it knows bounds of the robustness of its
 * formulas over all continuations, and a verdict as soon as nothing can change it.
 *
 * A function that can fail returns a status; mishandle_last_error has the text. A null pointer is an
 * error, never a crash. No panic leaves the library.
 *
 * Memory: mishandle_monitor_create allocates. No other function does, except a push that fails because
 * arithmetic of a formula has no value there (a division by zero, for instance), and a window of more
 * than 2^16 samples, which grows while samples arrive.
 *
 * Threads: two calls must not use one monitor at the same time. A monitor may move between threads, and
 * different monitors are independent. */

#ifndef MISHANDLE_MONITOR_H
#define MISHANDLE_MONITOR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/*
 Result of a function.
 */
typedef enum MishandleStatus {
  /*
   No error.
   */
  MISHANDLE_STATUS_OK = 0,
  /*
   A pointer is null.
   */
  MISHANDLE_STATUS_NULL_POINTER = 1,
  /*
   A formula, name, period, index or number of values is invalid.
   */
  MISHANDLE_STATUS_INVALID_ARGUMENT = 2,
  /*
   A value is NaN or infinite, in a signal that a formula reads, or arithmetic of a formula has
   no value. The sample does not count, and another can take its place. If the arithmetic is on
   values of temporal operators, the monitor needs a reset.
   */
  MISHANDLE_STATUS_INVALID_SAMPLE = 3,
  /*
   A defect of the library. The monitor can only be destroyed.
   */
  MISHANDLE_STATUS_PANIC = 4,
} MishandleStatus;

/*
 Verdict on a formula at the first sample.
 */
typedef enum MishandleVerdict {
  /*
   It depends on the samples that follow.
   */
  MISHANDLE_VERDICT_OPEN = 0,
  /*
   Satisfied, whatever follows.
   */
  MISHANDLE_VERDICT_SATISFIED = 1,
  /*
   Violated, whatever follows.
   */
  MISHANDLE_VERDICT_VIOLATED = 2,
} MishandleVerdict;

/*
 A monitor of some formulas over the same signals.
 */
typedef struct MishandleMonitor MishandleMonitor;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/*
 Creates a monitor.

 `formulas` and `signals` are arrays of texts in UTF-8, which end with 0. A sample has one value
 for each signal, in the order of `signals`. `period` is the time between two samples in seconds,
 or 0 if no bound of a formula has a unit. `samples` is the number of samples of the whole trace,
 or 0 if it is unknown. On success, `*monitor` is a monitor for mishandle_monitor_destroy,
 otherwise null.

 # Safety
 The pointers are null or valid for the stated numbers of elements.
 */
enum MishandleStatus mishandle_monitor_create(const char *const *formulas,
                                              size_t formula_count,
                                              const char *const *signals,
                                              size_t signal_count,
                                              double period,
                                              size_t samples,
                                              struct MishandleMonitor **monitor);

/*
 Adds a sample: `count` values, one for each signal.

 # Safety
 `monitor` is null or from mishandle_monitor_create and not destroyed; `values` is null or valid
 for `count` numbers.
 */
enum MishandleStatus mishandle_monitor_push(struct MishandleMonitor *monitor,
                                            const double *values,
                                            size_t count);

/*
 Returns the least and the greatest robustness of a formula at the first sample, over all
 continuations of the samples so far. `formula` is its index, from 0.

 # Safety
 `monitor` as for mishandle_monitor_push; the other pointers are null or valid.
 */
enum MishandleStatus mishandle_monitor_bounds(struct MishandleMonitor *monitor,
                                              size_t formula,
                                              double *low,
                                              double *high);

/*
 Returns the verdict on a formula at the first sample.

 # Safety
 As for mishandle_monitor_bounds.
 */
enum MishandleStatus mishandle_monitor_verdict(struct MishandleMonitor *monitor,
                                               size_t formula,
                                               enum MishandleVerdict *verdict);

/*
 Returns whether the last sample decided the robustness of a formula at a sample, which sample
 that is, and the robustness. Without a decision, `*sample` and `*robustness` stay as they are.

 # Safety
 As for mishandle_monitor_bounds.
 */
enum MishandleStatus mishandle_monitor_decided(struct MishandleMonitor *monitor,
                                               size_t formula,
                                               bool *is_decided,
                                               size_t *sample,
                                               double *robustness);

/*
 Forgets all samples and keeps the memory.

 # Safety
 As for mishandle_monitor_push.
 */
enum MishandleStatus mishandle_monitor_reset(struct MishandleMonitor *monitor);

/*
 Frees a monitor. Null is ignored.

 # Safety
 `monitor` is null or from mishandle_monitor_create, and nothing uses it afterwards.
 */
void mishandle_monitor_destroy(struct MishandleMonitor *monitor);

/*
 Returns the text of the last error of this thread, which is empty before the first one. It is
 valid until the next error of the thread, and is cut after 511 bytes.
 */
const char *mishandle_last_error(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* MISHANDLE_MONITOR_H */
