/* Loop over the cells of elements whose dilation θ and pressure p are constant in each cell.
 *
 * The kernels are those of the energy Π(u, θ, p) of `element.py`, with 2 unknowns beside the u of a
 * cell. Both are eliminated here: with the volume V of the cell and R = ∂Π/∂(u, θ, p),
 *
 *     R_p = ∫ J dV - V θ = 0,   R_θ = ∫ ∂W/∂θ dV - V p = 0,   K_θθ = a, K_θp = -V, K_pp = 0,
 *
 *     K = K_uu + (K_uθ K_pu + K_up K_θu) / V + a K_up K_pu / V². */

#include "element_kernel.h"

/* The arguments are those of `add_element_tensors` (element_loop.c), where n_entries is 1 (energy),
 * n_dofs (forces) or n_dofs² (tangent) and counts u only, and
 *
 * residual     kernel of R
 * of_residual  constants of R
 * volumes      (n_cells) V in m³
 * work         ((n_dofs + 2)² + 2 (n_dofs + 2) + 3 * n_vertices) scratch memory */
void add_mean_dilation_tensors(element_kernel *kernel, element_kernel *residual, int n_cells,
                               int n_entries, int n_dofs, int n_vertices, const int32_t *places,
                               const int32_t *dofs, const int32_t *vertices, const double *points,
                               const double *u, const double *constants, const double *of_residual,
                               const double *volumes, double *work, double *values)
{
    const int n = n_dofs, all = n_dofs + 2, theta = n, p = n + 1;
    double *tensor = work, *state = work + all * all, *r = state + all, *coordinates = r + all;
    const int is_tangent = n_entries == n * n, size = is_tangent ? all * all : n_entries == 1 ? 1 : all;
    for (int cell = 0; cell < n_cells; ++cell) {
        const double volume = volumes[cell];
        for (int i = 0; i < n; ++i)
            state[i] = u[dofs[cell * n + i]];
        for (int i = 0; i < n_vertices; ++i)
            for (int k = 0; k < 3; ++k)
                coordinates[3 * i + k] = points[3 * vertices[cell * n_vertices + i] + k];
        state[theta] = 1.0;
        state[p] = 0.0;
        for (int step = 0; step < 2; ++step) { /* θ from R_p, then p from R_θ, both linear */
            for (int i = 0; i < all; ++i)
                r[i] = 0.0;
            residual(r, state, of_residual, coordinates, 0, 0 AND_CUSTOM_DATA(0));
            if (step == 0)
                state[theta] += r[p] / volume;
            else
                state[p] = r[theta] / volume;
        }
        for (int i = 0; i < size; ++i)
            tensor[i] = 0.0;
        kernel(tensor, state, constants, coordinates, 0, 0 AND_CUSTOM_DATA(0));
        const int32_t *place = places + (int64_t)cell * n_entries;
        if (is_tangent) {
            const double *of_theta = tensor + theta * all, *of_p = tensor + p * all;
            const double a = of_theta[theta] / volume;
            for (int i = 0; i < n; ++i)
                for (int j = 0; j < n; ++j)
                    values[place[i * n + j]] +=
                        tensor[i * all + j] +
                        (of_theta[i] * of_p[j] + of_p[i] * (of_theta[j] + a * of_p[j])) / volume;
        } else
            for (int i = 0; i < n_entries; ++i)
                values[place[i]] += tensor[i];
    }
}
