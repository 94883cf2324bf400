// Copyright 2026 The sparse_coord_ros authors
// SPDX-License-Identifier: Apache-2.0
//
// Algorithm 1 of Melo & Veloso (2009) on one scenario as one plain C loop: what the batch engine
// is measured against. It draws the same random numbers in the same order and computes the same
// bits (compile without contraction of floating-point operations: -ffp-contract=off).

#include <stdbool.h>
#include <stdint.h>

enum { PRIMITIVES = 4, COORDINATE = 4, ACTIONS = 5, EPISODE_GAP = 2, NO_ROW = -1, NOWHERE = -1 };
enum { EXPLORE, EXPLORED_ACTION, TIE, PRIMITIVE_TIE, PEER, POLICY_DRAWS };

// A scenario; loop.py declares the same fields. k is a robot, x its cell.
struct problem {
    const int32_t *starts;         // [k]
    const int32_t *goals;          // [k]
    const int32_t *next_cell;      // [x][action]
    const int32_t *places;         // meeting place, NOWHERE outside doorways [x]
    const double *percept;         // success probability [x][cell of the peer]
    const double *penalties;       // [k]
    const int32_t *start_cells;    // exploring starts [k][number]
    const int32_t *start_counts;   // [k]
    const double *exploring;       // [time step], budget + 1 entries
    const double *epsilon;         // [time step], budget + 1 entries
    const double *alpha_by_count;  // [number of the update], budget + 1 entries
    const double *alpha_by_step;   // [time step], budget + 1 entries
    double move_success, goal_reward, ask_cost, discount, goal_value;
    int32_t budget, max_steps, team, cells, most_start_cells, fails;
};

// NumPy's PCG64: PCG XSL-RR 128/64.
struct pcg64 {
    unsigned __int128 state, increment;
};

struct robot {
    struct pcg64 policy_source, motion_source, percept_source, start_source;
    double policy[POLICY_DRAWS], motion, percept, start[2];  // the draws of this time step
    double *q_star, *q_coord;
    int32_t *star_updates, *coord_updates;
    int32_t cell, from, action, move, row;  // row of Q^C that was perceived, or NO_ROW
    bool arrived;
};

static inline double uniform(struct pcg64 *source)
{
    const unsigned __int128 multiplier =
        (unsigned __int128)0x2360ED051FC65DA4u << 64 | 0x4385DF649FCCF645u;
    source->state = source->state * multiplier + source->increment;
    uint64_t folded = (uint64_t)(source->state >> 64) ^ (uint64_t)source->state;
    unsigned turn = (unsigned)(source->state >> 122);
    uint64_t bits = folded >> turn | folded << (-turn & 63);
    return (double)(bits >> 11) * (1.0 / 9007199254740992.0);
}

// The draws of a time step; those of percepts that cannot fail are looked at by nobody.
static inline void draw(const struct problem *problem, struct robot *robots, int team)
{
    for (struct robot *robot = robots; robot < robots + team; robot++) {
        for (int i = 0; i < POLICY_DRAWS; i++)
            robot->policy[i] = uniform(&robot->policy_source);
        robot->motion = uniform(&robot->motion_source);
        if (problem->fails)
            robot->percept = uniform(&robot->percept_source);
        robot->start[0] = uniform(&robot->start_source);
        robot->start[1] = uniform(&robot->start_source);
    }
}

static inline int greedy(const double *values, int count, double tie)
{
    double best = values[0];
    int ties = 1;
    for (int action = 1; action < count; action++) {
        if (values[action] > best) {
            best = values[action];
            ties = 1;
        } else if (values[action] == best) {
            ties++;
        }
    }
    int chosen = (int)(tie * ties);
    for (int action = 0; action < count; action++)
        if (values[action] == best && chosen-- == 0)
            return action;
    return 0;
}

static inline double greatest(const double *values, int count)
{
    double best = values[0];
    for (int action = 1; action < count; action++)
        if (values[action] > best)
            best = values[action];
    return best;
}

// Begin an episode: every robot at its start, or at an exploring start.
static void place(const struct problem *problem, struct robot *robots, double exploring)
{
    for (int k = 0; k < problem->team; k++) {
        struct robot *robot = &robots[k];
        robot->cell = problem->starts[k];
        robot->arrived = false;
        if (robot->start[0] < exploring) {
            int pick = (int)(robot->start[1] * problem->start_counts[k]);
            robot->cell = problem->start_cells[(int64_t)k * problem->most_start_cells + pick];
        }
    }
}

// Robot k chooses (Algorithm 1, lines 4 to 10).
static inline void choose(const struct problem *problem, struct robot *robots, int k,
                          double epsilon)
{
    struct robot *robot = &robots[k];
    const double *values = robot->q_star + (int64_t)robot->cell * ACTIONS;
    robot->from = robot->cell;
    robot->row = NO_ROW;
    if (robot->policy[EXPLORE] < epsilon)
        robot->action = (int)(robot->policy[EXPLORED_ACTION] * ACTIONS);
    else
        robot->action = greedy(values, ACTIONS, robot->policy[TIE]);
    robot->move = robot->action;
    if (robot->action != COORDINATE)
        return;
    int peer = (int)(robot->policy[PEER] * (problem->team - 1));
    peer += peer >= k;
    int32_t row = robot->cell * problem->cells + robots[peer].cell;
    if (robot->percept < problem->percept[row]) {
        robot->row = row;
        values = robot->q_coord + (int64_t)row * PRIMITIVES;
    }
    robot->move = greedy(values, PRIMITIVES, robot->policy[PRIMITIVE_TIE]);
}

// Move the robots; return whether the step ends in a miscoordination.
static inline bool move(const struct problem *problem, struct robot *robots)
{
    for (struct robot *robot = robots; robot < robots + problem->team; robot++)
        if (!robot->arrived && robot->motion < problem->move_success)
            robot->cell = problem->next_cell[robot->cell * PRIMITIVES + robot->move];
    for (int i = 1; i < problem->team; i++) {
        int32_t place = problem->places[robots[i].cell];
        if (place == NOWHERE)
            continue;
        for (int j = 0; j < i; j++)
            if (problem->places[robots[j].cell] == place)
                return true;
    }
    return false;
}

// QLUpdate of one table entry.
static inline void update(const struct problem *problem, double *value, int32_t *updates,
                          double least_alpha, double reward, double bootstrap)
{
    double alpha = problem->alpha_by_count[++*updates];
    if (alpha < least_alpha)
        alpha = least_alpha;
    *value = (1.0 - alpha) * *value + alpha * (reward + problem->discount * bootstrap);
}

// Robot k learns from the step (Algorithm 1, lines 12 to 18); return whether it is at its goal.
static inline bool learn(const struct problem *problem, struct robot *robot, int k,
                         bool conflict, double least_alpha)
{
    bool home = robot->cell == problem->goals[k];
    double individual = home ? problem->goal_reward : 0.0;
    double common = conflict ? problem->penalties[k] : 0.0;
    double cost = robot->action == COORDINATE ? -problem->ask_cost : 0.0;
    double reward = individual + common + cost;
    double bootstrap = problem->goal_value;
    if (!home)
        bootstrap = greatest(robot->q_star + (int64_t)robot->cell * ACTIONS, ACTIONS);
    if (robot->row != NO_ROW) {
        int64_t entry = (int64_t)robot->row * PRIMITIVES + robot->move;
        update(problem, &robot->q_coord[entry], &robot->coord_updates[entry], least_alpha,
               reward, bootstrap);
    }
    int64_t entry = (int64_t)robot->from * ACTIONS + robot->action;
    update(problem, &robot->q_star[entry], &robot->star_updates[entry], least_alpha, reward,
           bootstrap);
    return home;
}

// One learning run.
//   sources:       generators at time step 0: policy, motion, start, percept [k][role]
//   q_star:        Q* from its initial values on, [k][x][action]
//   q_coord:       Q^C from its initial values on, [k][x][cell of the peer][action]
//   star_updates:  counts of the updates, 0, as q_star
//   coord_updates: likewise, as q_coord
void learn_run(const struct problem *problem, const struct pcg64 *sources, double *q_star,
               double *q_coord, int32_t *star_updates, int32_t *coord_updates)
{
    int team = problem->team;
    int64_t stars = (int64_t)problem->cells * ACTIONS;
    int64_t coords = (int64_t)problem->cells * problem->cells * PRIMITIVES;
    struct robot robots[team];
    for (int k = 0; k < team; k++, sources += 4)
        robots[k] = (struct robot){.policy_source = sources[0],
                                   .motion_source = sources[1],
                                   .start_source = sources[2],
                                   .percept_source = sources[3],
                                   .q_star = q_star + k * stars,
                                   .q_coord = q_coord + k * coords,
                                   .star_updates = star_updates + k * stars,
                                   .coord_updates = coord_updates + k * coords};
    draw(problem, robots, team);  // time step 0 is never played
    bool over = true;
    int64_t step = 0, episode_start = 0;
    for (int32_t done = 0; done < problem->budget; done++) {
        draw(problem, robots, team);
        step++;
        int32_t scheduled = step < problem->budget ? (int32_t)step : problem->budget;
        if (over) {
            place(problem, robots, problem->exploring[scheduled]);
            episode_start = step;
        }
        for (int k = 0; k < team; k++)
            if (!robots[k].arrived)
                choose(problem, robots, k, problem->epsilon[scheduled]);
        bool conflict = move(problem, robots);
        double least_alpha = problem->alpha_by_step[scheduled];
        over = true;
        for (int k = 0; k < team; k++) {
            if (!robots[k].arrived)
                robots[k].arrived = learn(problem, &robots[k], k, conflict, least_alpha);
            over &= robots[k].arrived;
        }
        over |= step + 1 - episode_start >= problem->max_steps;
        for (int i = 0; over && i < EPISODE_GAP; i++, step++)
            draw(problem, robots, team);
    }
}
