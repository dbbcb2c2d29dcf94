/* The loop over the cells: element matrices straight into the values of a CSR matrix.
 *
 * dolfinx hands every element matrix to PETSc, which looks up where each entry belongs; here the
 * places are known beforehand, since they are the same for every assembly. */

#include <stdint.h>

typedef void element_kernel(double *restrict matrix, const double *restrict coefficients,
                            const double *restrict constants, const double *restrict coordinates,
                            const int *restrict entity, const uint8_t *restrict permutation);

/* kernel       element matrix of one cell, as FFCx generates it
 * n_cells      cells
 * n_dofs       degrees of freedom of a cell
 * n_vertices   vertices of a cell
 * dofs         (n_cells, n_dofs) degrees of freedom of every cell
 * vertices     (n_cells, n_vertices) geometry nodes of every cell
 * points       (n_points, 3) positions of the geometry nodes
 * u            (n) displacement
 * places       (n_cells, n_dofs, n_dofs) where in `values` each entry is added
 * work         (n_dofs * n_dofs + n_dofs + 3 * n_vertices) scratch
 * values       values of the matrix, and one more behind them for entries that are dropped */
void add_element_matrices(element_kernel *kernel, int n_cells, int n_dofs, int n_vertices,
                          const int32_t *dofs, const int32_t *vertices, const double *points,
                          const double *u, const double *constants, const int32_t *places,
                          double *work, double *values)
{
    const int entries = n_dofs * n_dofs;
    double *matrix = work, *coefficients = work + entries, *coordinates = coefficients + n_dofs;
    for (int cell = 0; cell < n_cells; ++cell) {
        for (int i = 0; i < n_dofs; ++i)
            coefficients[i] = u[dofs[cell * n_dofs + i]];
        for (int i = 0; i < n_vertices; ++i)
            for (int k = 0; k < 3; ++k)
                coordinates[3 * i + k] = points[3 * vertices[cell * n_vertices + i] + k];
        for (int i = 0; i < entries; ++i)
            matrix[i] = 0.0;
        kernel(matrix, coefficients, constants, coordinates, 0, 0);
        const int32_t *place = places + (int64_t)cell * entries;
        for (int i = 0; i < entries; ++i)
            values[place[i]] += matrix[i];
    }
}
