/* Mass distributions of a known or unknown shape; what poise/inertia/bayes/mass_model.py does with numpy, and why, is
   said there. */
#ifndef POISE_MASS_H
#define POISE_MASS_H

#include "poise_kernels.h"

enum { PHI = 10, DEFORMATIONS = 9 };

/* Layout of `_Model` in poise/kernels/averaging.py. */
struct mass_model {
  int64_t parts, states, halvings;
  double scale, any_mass;
  const double *moments;  /* (parts, 16) */
  const double *shares;   /* (parts,) */
  const double *guess;    /* (states,) */
  const double *root;     /* (parts, parts) axes of the likeness, in columns; NULL for the unit matrix */
  const double *unrooted; /* (parts, parts) */
  const double *flat;     /* (9, 16) generators of deformations */
  const double *products; /* (9, 9, 16) of two of them */
};

/* phi (10,) and, unless it is NULL, its derivative (10, states), in units of the scale. */
void mass_at(const struct mass_model *model, const double *state, double *phi, double *jacobian);
/* (10, states) jacobian times the root of the likeness. */
void rooted(const struct mass_model *model, const double *jacobian, double *out);
/* (10,) sum of the jacobian over the parts. */
void by_mass(const struct mass_model *model, const double *jacobian, double *out);

#endif
