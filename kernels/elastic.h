/* Elastic contacts of a block of bodies, and equilibria of them by Newton steps. */
#ifndef POISE_ELASTIC_H
#define POISE_ELASTIC_H

#include "bodies.h"

/* The springs of all pairs, one pair after another. */
struct elastic {
  struct bodies bodies;
  const int64_t *springs;    /* (pairs + 1) first spring of each pair */
  const double *wrenches;    /* (springs, 3, 6) of unit forces along the normal and two tangents */
  const double *stiffness;   /* (springs) */
  const double *friction;    /* (springs) */
  double catch, slack;       /* stiffness that holds every body; by how much nothing presses */
};

/* An equilibrium under a load and a share of a push. */
struct reached {
  double factor, left; /* of the push; size of what is left of the equations */
  double compliance;   /* power of the push on the change of the displacement by it, in the last step; 0: no step */
  const double *change; /* (6 n) that change; it is kept until the next step */
  int64_t steps;
};

/* Room for Newton steps, for many equilibria. */
struct steps;
const struct elastic *elastic_contacts(const struct steps *made);
/* Begin a question: friction is limited by bounds (springs), or if these are NULL, by Coulomb's law. */
void elastic_begin(struct steps *made, const double *bounds);

/* Seconds of a clock. */
double elastic_clock(void);
/* u (6 n), of which the power of the push (6 n) does not change, becomes an equilibrium; `end` of the clock. */
struct reached elastic_reach(struct steps *made, const double *load, const double *push, double enough, int64_t steps,
                             double end, double *u);
/* u (6 n) moves towards the equilibrium under a load, by Newton steps until no more than `enough` is left. */
void elastic_settle(struct steps *made, const double *load, double enough, int64_t steps, double end, double *u);
/* u (6 n) becomes the change under a push (6 n) at a displacement; without `at`, where nothing opens or slips. */
int elastic_response(struct steps *made, const double *at, const double *push, double *u);
/* What springs and catch leave of a load at u, negated (6 n). */
void elastic_left(struct steps *made, const double *u, const double *load, double *out);

#endif
