// Copyright 2026 The sparse_coord_ros authors
// SPDX-License-Identifier: Apache-2.0
//
// The learner `factored` (docs/coordination.md) as one plain C loop, beside that of Algorithm 1: the
// same draws, the same bits. rho is a dense array here, so nothing is looked up.

#include "loop.c"

enum { NOT_ASKED = -1, FAILED = 0, PERCEIVED = 1 };

struct rule {
    double common_weight;
    int32_t replays, share, percept_update, right_of_way, referee;
};

// What one robot has learned; b is a move.
struct mind {
    double *u, *r_bar, *w, *value;                   // [x][b], [x][b], [x], [x]; Q* is the robot's
    double *rho, *unseen;                            // [x][peer][z][b], [x][b]
    int32_t *commons, *moved, *successor, *tried;    // [x][b], ..., [number]
    int32_t *rho_updates, *unseen_updates;
    int32_t used, seen;
    struct pcg64 replay_source, blind_source;
    double replay, blind[2];
    uint64_t askers, partners;
};

static inline double step_size(double by_count, double floor)
{
    return by_count > floor ? by_count : floor;
}

static inline double toward(double value, double alpha, double target)
{
    return value + alpha * (target - value);
}

static inline void refresh(const struct problem *problem, struct robot *robot, struct mind *mind,
                           int x)
{
    const double *u = mind->u + x * PRIMITIVES, *r_bar = mind->r_bar + x * PRIMITIVES;
    double *star = robot->q_star + x * ACTIONS;
    for (int b = 0; b < PRIMITIVES; b++)
        star[b] = u[b] + r_bar[b];
    star[COORDINATE] = greatest(u, PRIMITIVES) - problem->ask_cost + mind->w[x];
    mind->value[x] = greatest(star, ACTIONS);
}

// Q^C(x, z, .) - U(x, .) of what was perceived.
static inline void correct(const struct problem *problem, const struct robot *robots,
                           const struct mind *mind, int k, int x, int seen, bool right_of_way,
                           double *correction)
{
    for (int b = 0; b < PRIMITIVES; b++)
        correction[b] = seen == FAILED ? mind->unseen[x * PRIMITIVES + b] : 0.0;
    if (seen == FAILED)
        return;
    for (int peer = 0; peer < problem->team; peer++) {
        if (peer == k || (right_of_way && robots[peer].from == x && k < peer))
            continue;
        int64_t row = ((int64_t)x * problem->team + peer) * problem->cells + robots[peer].from;
        for (int b = 0; b < PRIMITIVES; b++)
            correction[b] += mind->rho[row * PRIMITIVES + b];
    }
}

static inline void choose_factored(const struct problem *problem, const struct rule *rule,
                                   struct robot *robots, struct mind *minds, int k, double epsilon)
{
    struct robot *robot = &robots[k];
    struct mind *mind = &minds[k];
    int x = robot->cell;
    mind->seen = NOT_ASKED;
    if (robot->policy[EXPLORE] < epsilon)
        robot->action = (int)(robot->policy[EXPLORED_ACTION] * ACTIONS);
    else
        robot->action = greedy(robot->q_star + (int64_t)x * ACTIONS, ACTIONS, robot->policy[TIE]);
    robot->move = robot->action;
    if (robot->action != COORDINATE)
        return;
    mind->seen = PERCEIVED;
    for (int peer = 0; peer < problem->team; peer++) {
        if (peer == k)
            continue;
        minds[peer].askers |= (uint64_t)1 << k;
        if (robot->percept >= problem->percept[(int64_t)x * problem->cells + robots[peer].cell]) {
            mind->seen = FAILED;
            break;
        }
    }
    double values[PRIMITIVES];
    correct(problem, robots, mind, k, x, mind->seen, rule->right_of_way, values);
    for (int b = 0; b < PRIMITIVES; b++)
        values[b] = mind->u[x * PRIMITIVES + b] + values[b];
    if (mind->seen == FAILED && mind->blind[0] < epsilon)
        robot->move = (int)(mind->blind[1] * PRIMITIVES);
    else
        robot->move = greedy(values, PRIMITIVES, robot->policy[PRIMITIVE_TIE]);
}

static inline void learn_row(const struct problem *problem, double *rho, int32_t *updates, int m,
                             double common, double floor)
{
    int32_t count = ++updates[m];
    int32_t place = count + 1 < problem->budget ? count + 1 : problem->budget;
    rho[m] = toward(rho[m], step_size(problem->alpha_by_count[place], floor), common);
}

static inline void replay(const struct problem *problem, struct robot *robot, struct mind *mind,
                          int replays, double arrival, int goal)
{
    double draw = mind->replay;
    for (int i = 0; i < replays; i++) {
        double scaled = draw * mind->used;
        int place = (int)scaled;
        draw = scaled - place;
        int pair = mind->tried[place], x = pair / PRIMITIVES, m = pair % PRIMITIVES;
        double share = (double)mind->moved[pair] / robot->star_updates[x * ACTIONS + m];
        int s = mind->successor[pair];
        double there = s == goal ? arrival : problem->discount * mind->value[s];
        double here = problem->discount * mind->value[x];
        mind->u[pair] = share * there + (1.0 - share) * here;
        refresh(problem, robot, mind, x);
    }
}

static inline bool learn_factored(const struct problem *problem, const struct rule *rule,
                                  struct robot *robots, struct mind *minds, int k, bool conflict,
                                  double floor)
{
    struct robot *robot = &robots[k];
    struct mind *mind = &minds[k];
    int x = robot->from, m = robot->move, y = robot->cell, goal = problem->goals[k];
    int64_t entry = (int64_t)x * PRIMITIVES + m;
    bool home = y == goal, asked = mind->seen != NOT_ASKED;
    double individual = home ? problem->goal_reward : 0.0;
    double common = conflict ? problem->penalties[k] : 0.0;
    if (mind->partners == 0)
        common = 0.0;
    common = rule->common_weight * common;

    int32_t count = ++robot->star_updates[x * ACTIONS + m];
    if (count == 1)
        mind->tried[mind->used++] = (int32_t)entry;
    if (y != x) {
        mind->moved[entry]++;
        mind->successor[entry] = y;
    }
    double after = home ? problem->goal_value : mind->value[y];
    double alpha = step_size(problem->alpha_by_count[count], floor);
    mind->u[entry] = toward(mind->u[entry], alpha, individual + problem->discount * after);
    if (!asked) {
        count = ++mind->commons[entry];
        mind->r_bar[entry] = toward(mind->r_bar[entry], step_size(1.0 / (count + 1), floor), common);
    }
    if (mind->seen == PERCEIVED || mind->askers) {
        for (int peer = 0; peer < problem->team; peer++) {
            int z = robots[peer].from;
            bool known = mind->seen == PERCEIVED;
            if (!known && rule->share && mind->askers >> peer & 1)
                known = robot->percept < problem->percept[(int64_t)x * problem->cells + z];
            if (!known || peer == k)
                continue;
            int64_t row = (((int64_t)x * problem->team + peer) * problem->cells + z) * PRIMITIVES;
            learn_row(problem, mind->rho + row, mind->rho_updates + row, m,
                      mind->partners >> peer & 1 ? common : 0.0, floor);
        }
    }
    if (asked) {
        double correction[PRIMITIVES];
        const double *u = mind->u + x * PRIMITIVES;
        if (mind->seen == FAILED)
            learn_row(problem, mind->unseen + x * PRIMITIVES, mind->unseen_updates + x * PRIMITIVES,
                      m, common, floor);
        correct(problem, robots, mind, k, x, mind->seen, rule->right_of_way, correction);
        double best = u[0] + correction[0];
        for (int b = 1; b < PRIMITIVES; b++)
            if (u[b] + correction[b] > best)
                best = u[b] + correction[b];
        count = ++robot->star_updates[x * ACTIONS + COORDINATE];
        alpha = step_size(problem->alpha_by_count[count], floor);
        mind->w[x] = toward(mind->w[x], alpha, best - greatest(u, PRIMITIVES));
        if (rule->percept_update)
            for (int b = 0; b < PRIMITIVES; b++)
                mind->r_bar[x * PRIMITIVES + b] =
                    toward(mind->r_bar[x * PRIMITIVES + b], floor, correction[b]);
    }
    refresh(problem, robot, mind, x);
    double arrival = problem->goal_reward + problem->discount * problem->goal_value;
    replay(problem, robot, mind, rule->replays, arrival, goal);
    return home;
}

static void find_partners(const struct problem *problem, const struct robot *robots,
                          struct mind *minds)
{
    for (int k = 0; k < problem->team; k++) {
        minds[k].partners = 0;
        int32_t place = problem->places[robots[k].cell];
        if (place == NOWHERE)
            continue;
        for (int j = 0; j < problem->team; j++)
            if (j != k && problem->places[robots[j].cell] == place)
                minds[k].partners |= (uint64_t)1 << j;
    }
}

static inline void draw_factored(const struct problem *problem, struct robot *robots,
                                 struct mind *minds)
{
    draw(problem, robots, problem->team);
    for (struct mind *mind = minds; mind < minds + problem->team; mind++) {
        mind->replay = uniform(&mind->replay_source);
        if (problem->fails) {
            mind->blind[0] = uniform(&mind->blind_source);
            mind->blind[1] = uniform(&mind->blind_source);
        }
    }
}

// Learn once. Arrays that are filled, k first: q_star [x][action], u and r_bar [x][b], w [x],
// rho [x][peer][z][b] and, after all these, that of failed percepts [x][b].
// Returns 0, or 1 where there is not enough memory.
int learn_run_factored(const struct problem *problem, const struct rule *rule,
                       const uint64_t *sources, double *q_star, double *u, double *r_bar,
                       double *w, double *rho)
{
    int team = problem->team;
    int64_t cells = problem->cells, pairs = cells * PRIMITIVES, stars = cells * ACTIONS;
    int64_t rows = cells * team * cells * PRIMITIVES;
    int64_t counted = stars + 4 * pairs + rows + pairs;
    struct robot *robots = calloc(team, sizeof *robots);
    struct mind *minds = calloc(team, sizeof *minds);
    int32_t *counts = calloc(team * counted, sizeof *counts);
    double *value = calloc(team * cells, sizeof *value);
    if (!robots || !minds || !counts || !value) {
        free(robots);
        free(minds);
        free(counts);
        free(value);
        return 1;
    }
    for (int k = 0; k < team; k++) {
        struct robot *robot = &robots[k];
        struct mind *mind = &minds[k];
        struct pcg64 *source[] = {&robot->policy_source,  &robot->motion_source,
                                  &robot->percept_source, &robot->start_source,
                                  &mind->replay_source,   &mind->blind_source};
        for (int role = 0; role < 6; role++, sources += 4) {
            source[role]->state = (unsigned __int128)sources[0] << 64 | sources[1];
            source[role]->increment = (unsigned __int128)sources[2] << 64 | sources[3];
        }
        robot->q_star = q_star + k * stars;
        mind->u = u + k * pairs;
        mind->r_bar = r_bar + k * pairs;
        mind->w = w + k * cells;
        mind->value = value + k * cells;
        mind->rho = rho + k * (rows + pairs);
        mind->unseen = mind->rho + rows;
        robot->star_updates = counts + k * counted;
        mind->commons = robot->star_updates + stars;
        mind->moved = mind->commons + pairs;
        mind->successor = mind->moved + pairs;
        mind->tried = mind->successor + pairs;
        mind->rho_updates = mind->tried + pairs;
        mind->unseen_updates = mind->rho_updates + rows;
        for (int64_t i = 0; i < pairs; i++)
            mind->u[i] = problem->q_coord_init;
        for (int x = 0; x < cells; x++)
            refresh(problem, robot, mind, x);
        mind->partners = ~(uint64_t)0;  // nobody says who it was
    }

    draw_factored(problem, robots, minds);  // time step 0 is never played
    bool placed = false;
    int64_t episode_start = 0, step = 0;
    for (int32_t done = 0; done < problem->budget; done++) {
        draw_factored(problem, robots, minds);
        step++;
        int32_t scheduled = step < problem->budget ? (int32_t)step : problem->budget;
        if (!placed) {
            place(problem, robots, problem->exploring[scheduled]);
            episode_start = step;
            placed = true;
        }
        for (int k = 0; k < team; k++) {
            minds[k].askers = 0;
            robots[k].from = robots[k].cell;
        }
        for (int k = 0; k < team; k++)
            if (!robots[k].arrived)
                choose_factored(problem, rule, robots, minds, k, problem->epsilon[scheduled]);
        bool conflict = move(problem, robots);
        if (rule->referee)
            find_partners(problem, robots, minds);
        bool over = true;
        for (int k = 0; k < team; k++) {
            if (!robots[k].arrived)
                robots[k].arrived = learn_factored(problem, rule, robots, minds, k, conflict,
                                                   problem->alpha_by_step[scheduled]);
            over &= robots[k].arrived;
        }
        if (over || step + 1 - episode_start >= problem->max_steps) {
            for (int i = 0; i < EPISODE_GAP; i++)
                draw_factored(problem, robots, minds);
            step += EPISODE_GAP;
            placed = false;
        }
    }
    free(robots);
    free(minds);
    free(counts);
    free(value);
    return 0;
}
