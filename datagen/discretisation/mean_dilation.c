/* Loop over the cells of elements whose dilation θ and pressure p are constant in each cell.
 *
 * The kernels are those of the energy Π(u, θ, p) of `element.py`, with 2 unknowns beside the u of a
 * cell. Both are eliminated here: with the volume V of the cell and R = ∂Π/∂(u, θ, p),
 *
 *     R_p = ∫ J dV - V θ = 0,   R_θ = ∫ ∂W/∂θ dV - V p = 0,   K_θθ = a, K_θp = -V, K_pp = 0,
 *
 *     K = K_uu + (K_uθ K_pu + K_up K_θu) / V + a K_up K_pu / V².
 *
 * In Newton's method, the tangent at u takes its p not from θ(u) but from the dilation that the last
 * tangent, at u', foretold: θ(u') + ∂θ/∂u (u - u'). So does Newton's method with the unknowns u, θ
 * and p. Where the material is nearly incompressible, the p of θ(u) is far from that of the
 * equilibrium, and many more iterations are necessary (Magisano, Leonetti and Garcea 2017). */

#include "element_kernel.h"

typedef struct {
    element_kernel *deformed_volume, *residual;
    const double *constants, *coordinates;
    int n;         /* number of u of a cell; θ and p follow them in the state */
    double volume; /* V */
    double *state, *r;
} mean_dilation_cell;

/* θ of R_p = 0 at the u of the state. */
static double dilation(mean_dilation_cell *cell)
{
    double deformed = 0.0;
    cell->deformed_volume(&deformed, cell->state, 0, cell->coordinates, 0, 0 AND_CUSTOM_DATA(0));
    return deformed / cell->volume;
}

/* p of R_θ = 0. Changes θ and p of the state. */
static double pressure(mean_dilation_cell *cell, double theta)
{
    cell->state[cell->n] = theta;
    cell->state[cell->n + 1] = 0.0;
    for (int i = 0; i < cell->n + 2; ++i)
        cell->r[i] = 0.0;
    cell->residual(cell->r, cell->state, cell->constants, cell->coordinates, 0, 0 AND_CUSTOM_DATA(0));
    return cell->r[cell->n] / cell->volume;
}

/* θ(u') + ∂θ/∂u (u - u'). θ is a cubic polynomial on the line through u' and u, whose slope the central
 * difference of fourth order gives exactly. */
static double foretold_dilation(mean_dilation_cell *cell, const int32_t *dofs, const double *u,
                                const double *before)
{
    const double at[] = {0.0, -2.0, -1.0, 1.0, 2.0}, weight[] = {12.0, 1.0, -8.0, 8.0, -1.0};
    double sum = 0.0;
    for (int k = 0; k < 5; ++k) {
        for (int i = 0; i < cell->n; ++i)
            cell->state[i] = before[dofs[i]] + at[k] * (u[dofs[i]] - before[dofs[i]]);
        sum += weight[k] * dilation(cell) / 12.0;
    }
    return sum;
}

/* The arguments are those of `add_element_tensors` (element_loop.c), where n_entries is 1 (energy),
 * n_dofs (forces) or n_dofs² (tangent) and counts u only, and
 *
 * deformed     kernel of ∫ J dV
 * residual     kernel of R
 * of_residual  constants of R
 * volumes      (n_cells) V in m³
 * before       u' in the layout of u; u itself for the derivative of the forces
 * given        (n_cells, n_given) given values, which follow u, θ and p
 * work         ((n_dofs + 2)² + 2 (n_dofs + 2) + n_given + 3 * n_vertices) scratch memory */
void add_mean_dilation_tensors(element_kernel *kernel, element_kernel *deformed,
                               element_kernel *residual, int n_cells, int n_entries, int n_dofs,
                               int n_vertices, int n_given, const int32_t *places, const int32_t *dofs,
                               const int32_t *vertices, const double *points, const double *u,
                               const double *constants, const double *of_residual,
                               const double *volumes, const double *before,
                               const double *given, double *work, double *values)
{
    const int n = n_dofs, all = n_dofs + 2, theta = n, p = n + 1;
    double *tensor = work, *state = work + all * all, *r = state + all + n_given;
    double *coordinates = r + all;
    const int is_tangent = n_entries == n * n, size = is_tangent ? all * all : n_entries == 1 ? 1 : all;
    for (int c = 0; c < n_cells; ++c) {
        const int32_t *own = dofs + c * n;
        mean_dilation_cell cell = {deformed, residual, of_residual, coordinates, n, volumes[c], state, r};
        for (int i = 0; i < n_vertices; ++i)
            for (int k = 0; k < 3; ++k)
                coordinates[3 * i + k] = points[3 * vertices[c * n_vertices + i] + k];
        for (int i = 0; i < n_given; ++i)
            state[all + i] = given[c * n_given + i];
        const double foretold = is_tangent ? foretold_dilation(&cell, own, u, before) : 1.0;
        for (int i = 0; i < n; ++i)
            state[i] = u[own[i]];
        const double now = dilation(&cell);
        const double of_cell = pressure(&cell, is_tangent && foretold > 0.0 ? foretold : now);
        state[theta] = now;
        state[p] = of_cell;
        for (int i = 0; i < size; ++i)
            tensor[i] = 0.0;
        kernel(tensor, state, constants, coordinates, 0, 0 AND_CUSTOM_DATA(0));
        const int32_t *place = places + (int64_t)c * n_entries;
        if (is_tangent) {
            const double *of_theta = tensor + theta * all, *of_p = tensor + p * all;
            const double a = of_theta[theta] / cell.volume;
            for (int i = 0; i < n; ++i)
                for (int j = 0; j < n; ++j)
                    values[place[i * n + j]] +=
                        tensor[i * all + j] +
                        (of_theta[i] * of_p[j] + of_p[i] * (of_theta[j] + a * of_p[j])) / cell.volume;
        } else
            for (int i = 0; i < n_entries; ++i)
                values[place[i]] += tensor[i];
    }
}
