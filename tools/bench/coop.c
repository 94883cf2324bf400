/* Copyright 2026 The sparse_coord_ros authors
 * SPDX-License-Identifier: Apache-2.0
 *
 * A learning run of coop in plain C: two robots that always perceive each other by COORDINATE.
 * Game, draws and protocol are the package's, and so are the bits. Lines are those of Algorithm 1.
 */
#include <stdbool.h>
#include <stdint.h>

enum { MOVES = 4, COORDINATE = 4, ACTIONS = 5, ROBOTS = 2, EPISODE_GAP = 2, COLUMNS = 64 };
enum { ENVIRONMENT, ROBOT, ROLES };
enum { MOTION, PERCEPT, START, START_CELL };
enum { PEER, EXPLORE, EXPLORED_ACTION, TIE, MOVE_TIE };

typedef struct {
    uint64_t seed;
    int64_t steps, max_steps, cells;
    const int64_t *next_cell, *doorway, *starts, *goals, *start_cells, *start_counts;
    const double *epsilon, *floors, *exploring, *step_sizes;
    double penalty, goal_reward, ask_cost, move_success, discount, goal_value;
    double *q_star, *q_coord; /* [k][x][action], [k][x][z][move] */
    int32_t *updates, *coord_updates;
} Run;

static uint64_t output(uint64_t seed, uint64_t number) { /* SplitMix64 */
    uint64_t z = seed + (number + 1) * 0x9E3779B97F4A7C15u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

static double draw(uint64_t key, int64_t step, int column) {
    return (output(key, step * COLUMNS + column) >> 11) * 0x1p-53;
}

static double greatest(const double *row, int count) {
    double best = row[0];
    for (int b = 1; b < count; b++)
        if (row[b] > best) best = row[b];
    return best;
}

static int greedy(const double *row, int count, uint64_t key, int64_t step, int column) {
    double best = greatest(row, count);
    int ties = 0, last = 0;
    for (int b = 0; b < count; b++) {
        ties += row[b] == best;
        if (row[b] == best) last = b;
    }
    if (ties == 1) return last;
    int number = (int)(draw(key, step, column) * ties);
    for (int b = 0; b < count; b++)
        if (row[b] == best && number-- == 0) return b;
    return last;
}

static void ql_update(const Run *run, double *value, int32_t *updates, double floor, double target) {
    double alpha = run->step_sizes[++*updates];
    if (alpha < floor) alpha = floor;
    *value = (1 - alpha) * *value + alpha * target;
}

void learn(const Run *run) {
    const int64_t n = run->cells;
    uint64_t keys[ROLES][ROBOTS];
    int64_t x[ROBOTS], y[ROBOTS], step = 1, begun = 0;
    int action[ROBOTS], move[ROBOTS];
    bool arrived[ROBOTS], placed = false;
    for (int k = 0; k < ROBOTS; k++)
        for (int role = 0; role < ROLES; role++) keys[role][k] = output(run->seed, 4 * k + role);

    for (int64_t done = 0; done < run->steps; done++) {
        int64_t now = step < run->steps ? step : run->steps;
        if (!placed) { /* line 2 */
            for (int k = 0; k < ROBOTS; k++) {
                uint64_t key = keys[ENVIRONMENT][k];
                arrived[k] = false;
                x[k] = run->starts[k];
                if (draw(key, step, START) < run->exploring[now])
                    x[k] = run->start_cells[k * n + (int64_t)(draw(key, step, START_CELL) * run->start_counts[k])];
            }
            begun = step;
            placed = true;
        }
        for (int k = 0; k < ROBOTS; k++) {
            y[k] = x[k];
            if (arrived[k]) continue;
            uint64_t key = keys[ROBOT][k];
            if (draw(key, step, EXPLORE) < run->epsilon[now]) /* line 4 */
                action[k] = (int)(draw(key, step, EXPLORED_ACTION) * ACTIONS);
            else
                action[k] = greedy(run->q_star + (k * n + x[k]) * ACTIONS, ACTIONS, key, step, TIE);
            move[k] = action[k];
            if (action[k] == COORDINATE) /* lines 5 to 7 */
                move[k] = greedy(run->q_coord + ((k * n + x[k]) * n + x[1 - k]) * MOVES, MOVES, key, step, MOVE_TIE);
            if (draw(keys[ENVIRONMENT][k], step, MOTION) < run->move_success)
                y[k] = run->next_cell[x[k] * MOVES + move[k]];
        }
        double common = y[0] == y[1] && run->doorway[y[0]] ? run->penalty : 0;
        for (int k = 0; k < ROBOTS; k++) {
            if (arrived[k]) continue;
            arrived[k] = y[k] == run->goals[k];
            bool asked = action[k] == COORDINATE;
            double reward = (arrived[k] ? run->goal_reward : 0) + common - (asked ? run->ask_cost : 0);
            double after = arrived[k] ? run->goal_value : greatest(run->q_star + (k * n + y[k]) * ACTIONS, ACTIONS);
            double target = reward + run->discount * after;
            if (asked) { /* lines 12 and 13 */
                int64_t entry = ((k * n + x[k]) * n + x[1 - k]) * MOVES + move[k];
                ql_update(run, run->q_coord + entry, run->coord_updates + entry, run->floors[now], target);
            }
            int64_t entry = (k * n + x[k]) * ACTIONS + action[k]; /* line 18 */
            ql_update(run, run->q_star + entry, run->updates + entry, run->floors[now], target);
        }
        for (int k = 0; k < ROBOTS; k++) x[k] = y[k];
        step++;
        if ((arrived[0] && arrived[1]) || step - begun >= run->max_steps) {
            step += EPISODE_GAP;
            placed = false;
        }
    }
}
