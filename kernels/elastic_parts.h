/* Motions, forces and stiffness of springs for elastic.c, with eight springs in parts; see three_widths.h. */

#define CHOSEN(where, a, b) ((part)(((where) & (choice)(a)) | (~(where) & (choice)(b))))

static POISE_INLINE void NAMED(part_roots)(part *numbers) {
  double lanes[EACH];
  memcpy(lanes, numbers, sizeof lanes);
  for (int l = 0; l < EACH; l++) lanes[l] = sqrt(lanes[l]);
  memcpy(numbers, lanes, sizeof lanes);
}

/* out (count, 3) = motion of the second body relative to the first at each spring */
static void NAMED(spring_motions)(const struct lanes *lanes, const double *u, row_of_block *restrict out) {
  const struct bodies *bodies = &lanes->contacts->bodies;
  for (int64_t pair = 0; pair < bodies->pairs; pair++) {
    const double *frame = lanes->frames + 9 * pair;
    double motion[SIDE], v[3], w[3];
    relative_motion(bodies, pair, u, motion);
    for (int i = 0; i < 3; i++) {
      v[i] = along(motion, frame + 3 * i);
      w[i] = along(motion + 3, frame + 3 * i);
    }
    for (int64_t row = 3 * lanes->first[pair]; row < 3 * lanes->first[pair + 1]; row += 3)
      for (int p = 0; p < PARTS; p++) {
        const part *arms = (const part *)(lanes->arms + row) + p;
        part *place = (part *)(out + row) + p;
        place[0] = v[0] + (arms[PARTS] * w[1] - arms[0] * w[2]);
        place[PARTS] = v[1] + (arms[2 * PARTS] * w[2] - arms[PARTS] * w[0]);
        place[2 * PARTS] = v[2] + (arms[0] * w[0] - arms[2 * PARTS] * w[1]);
      }
  }
}

/* Forces (3) of a part of eight springs, from their motions (3), which are parts of rows; friction is limited by
   `bounds`, or by Coulomb's law where those are NULL. */
static POISE_INLINE void NAMED(spring_forces)(const struct lanes *lanes, int64_t eight, int p, const part *motion,
                                              part *force) {
  const part none = {0.0}, one = none + 1.0, k = -((const part *)(lanes->stiffness + eight))[p];
  for (int i = 0; i < 3; i++) force[i] = k * motion[PARTS * i];
  force[0] = CHOSEN(force[0] > none, force[0], none);
  const part limit = lanes->bounds ? ((const part *)(lanes->bounds + eight))[p]
                                   : ((const part *)(lanes->friction + eight))[p] * force[0];
  const part square = force[1] * force[1] + force[2] * force[2];
  const choice over = square > limit * limit;
  part size = CHOSEN(over, square, one);
  NAMED(part_roots)(&size);
  const part share = CHOSEN(over, limit / size, one);
  force[1] *= share;
  force[2] *= share;
}

/* (6) sums of the forces of a pair along its frame, and of their moments. */
static POISE_INLINE void NAMED(wrench_of_pair)(const struct lanes *lanes, int64_t pair, const row_of_block *relative,
                                               double *sum) {
  double lane[SIDE][WIDTH];
  for (int p = 0; p < PARTS; p++) {
    part sums[SIDE] = {{0.0}}, force[3];
    for (int64_t eight = lanes->first[pair]; eight < lanes->first[pair + 1]; eight++) {
      const part *arms = (const part *)(lanes->arms + 3 * eight) + p;
      NAMED(spring_forces)(lanes, eight, p, (const part *)(relative + 3 * eight) + p, force);
      for (int i = 0; i < 3; i++) sums[i] += force[i];
      sums[3] += arms[0] * force[2] - arms[PARTS] * force[1];
      sums[4] += arms[PARTS] * force[0] - arms[2 * PARTS] * force[2];
      sums[5] += arms[2 * PARTS] * force[1] - arms[0] * force[0];
    }
    for (int i = 0; i < SIDE; i++) memcpy(lane[i] + EACH * p, sums + i, sizeof(part));
  }
  for (int i = 0; i < SIDE; i++)
    sum[i] = ((lane[i][0] + lane[i][1]) + (lane[i][2] + lane[i][3])) +
             ((lane[i][4] + lane[i][5]) + (lane[i][6] + lane[i][7]));
}

/* out (6 n) = what springs and catch leave of a load, negated */
static void NAMED(left_over)(const struct lanes *lanes, const double *u, const double *load,
                             const row_of_block *relative, double *restrict out) {
  const struct elastic *contacts = lanes->contacts;
  for (int64_t i = 0; i < SIDE * contacts->bodies.count; i++) out[i] = contacts->catch * u[i] - load[i];
  for (int64_t pair = 0; pair < contacts->bodies.pairs; pair++) {
    if (!acts(lanes, pair, relative)) continue;
    double sum[SIDE], wrench[SIDE];
    NAMED(wrench_of_pair)(lanes, pair, relative, sum);
    const double *frame = lanes->frames + 9 * pair;
    for (int j = 0; j < SIDE; j++) {
      const double *three = sum + j / 3 * 3, *axis = frame + j % 3;
      wrench[j] = -(three[0] * axis[0] + three[1] * axis[3] + three[2] * axis[6]);
    }
    add_wrench(&contacts->bodies, pair, wrench, out);
  }
}

/* What opens keeps a trace of stiffness. Without a motion, nothing opens or slips. `own` has rows of eight. */
static POISE_INLINE void NAMED(spring_stiffness)(const struct lanes *lanes, int64_t eight, int p, const part *motion,
                                                 double damping, part *own) {
  const part none = {0.0}, one = none + 1.0, k = ((const part *)(lanes->stiffness + eight))[p];
  if (!motion) {
    own[PARTS * NORMAL] = own[PARTS * FIRST] = own[PARTS * SECOND] = k;
    own[PARTS * BETWEEN] = own[PARTS * FIRST_FOLLOWS] = own[PARTS * SECOND_FOLLOWS] = none;
    return;
  }
  const part normal = motion[0], along_first = motion[PARTS], along_second = motion[2 * PARTS];
  const choice closed = normal <= none;
  part slide = along_first * along_first + along_second * along_second;
  NAMED(part_roots)(&slide);
  const part follows = -((const part *)(lanes->friction + eight))[p] * k, pressed = CHOSEN(closed, normal, none);
  const part limit = lanes->bounds ? ((const part *)(lanes->bounds + eight))[p] : follows * pressed;
  const choice slips = k * slide > limit;
  const part safe = CHOSEN(slide > none, slide, one), first = along_first / safe, second = along_second / safe;
  const part coupled = CHOSEN(closed, follows, none), turning = CHOSEN(slips, limit / safe, none);
  const part sticking = (CHOSEN(slips, none, one) + damping) * k;
  own[PARTS * NORMAL] = (CHOSEN(closed, one, none + SPARE) + damping) * k;
  own[PARTS * FIRST] = sticking + turning * second * second;
  own[PARTS * SECOND] = sticking + turning * first * first;
  own[PARTS * BETWEEN] = -turning * first * second;
  own[PARTS * FIRST_FOLLOWS] = lanes->bounds ? none : CHOSEN(slips, coupled * first, none);
  own[PARTS * SECOND_FOLLOWS] = lanes->bounds ? none : CHOSEN(slips, coupled * second, none);
}

/* total (6) rows += the stiffness of springs from p on, `count` of an eight, whose derivatives are `own`. */
static POISE_INLINE void NAMED(add_springs)(const struct lanes *lanes, int64_t p, int64_t count,
                                            const double (*own)[WIDTH], row_of_block *total) {
  for (int place = 0; place < PARTS; place++) {
    part sums[SIDE];
#pragma GCC unroll 6
    for (int i = 0; i < SIDE; i++) sums[i] = ((const part *)(total + i))[place];
    for (int64_t l = 0; l < count; l++) {
      const double *wrench = wrenches_of(lanes, p + l);
      part unit[3], rows[3];
#pragma GCC unroll 3
      for (int i = 0; i < 3; i++) memcpy(unit + i, wrench + SIDE * i + EACH * place, sizeof(part));
      rows[0] = own[NORMAL][l] * unit[0];
      rows[1] = own[FIRST_FOLLOWS][l] * unit[0] + own[FIRST][l] * unit[1] + own[BETWEEN][l] * unit[2];
      rows[2] = own[SECOND_FOLLOWS][l] * unit[0] + own[BETWEEN][l] * unit[1] + own[SECOND][l] * unit[2];
#pragma GCC unroll 6
      for (int i = 0; i < SIDE; i++)
        sums[i] += wrench[i] * rows[0] + wrench[SIDE + i] * rows[1] + wrench[2 * SIDE + i] * rows[2];
    }
#pragma GCC unroll 6
    for (int i = 0; i < SIDE; i++) ((part *)(total + i))[place] = sums[i];
  }
}

/* The stiffness of `bodies`, which are those of the contacts in any order; only of pairs that are `coupled`, where that
   is given. Without forces, pairs with the ground keep a trace of stiffness, and pairs of bodies have none. */
static void NAMED(assemble)(const struct lanes *lanes, const struct bodies *bodies, const row_of_block *relative,
                            double damping, const char *coupled, struct body_matrix *matrix) {
  const struct elastic *contacts = lanes->contacts;
  bodies_clear(bodies, matrix, contacts->catch);
  for (int64_t pair = 0; pair < contacts->bodies.pairs; pair++) {
    if (coupled && !coupled[pair]) continue;
    row_of_block total[SIDE];
    memset(total, 0, sizeof total);
    int64_t first = contacts->springs[pair];
    for (int64_t eight = lanes->first[pair]; eight < lanes->first[pair + 1]; eight++, first += WIDTH) {
      const int64_t left = contacts->springs[pair + 1] - first;
      row_of_block own[DERIVATIVES];
      for (int p = 0; p < PARTS; p++)
        NAMED(spring_stiffness)(lanes, eight, p, relative ? (const part *)(relative + 3 * eight) + p : NULL, damping,
                                (part *)own + p);
      NAMED(add_springs)(lanes, first, left < WIDTH ? left : WIDTH, (const double (*)[WIDTH])own, total);
    }
    bodies_add(bodies, matrix, pair, total);
  }
}

#undef CHOSEN
