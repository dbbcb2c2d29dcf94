/* Loop over the cells: evaluate each element tensor and add its entries to the assembled values.
 *
 * dolfinx passes every element matrix to PETSc, which searches for the place of each entry. Here
 * the places are given, since they are the same in every assembly. */

#include "element_kernel.h"

/* kernel       element tensor of one cell, as FFCx generates it
 * n_cells      number of cells
 * n_entries    number of entries of an element tensor
 * n_dofs       number of degrees of freedom of a cell
 * n_vertices   number of vertices of a cell
 * n_given      number of given values of a cell, which follow its degrees of freedom
 * places       (n_cells, n_entries) index into `values` to which each entry is added
 * dofs         (n_cells, n_dofs) degrees of freedom of every cell
 * vertices     (n_cells, n_vertices) geometry nodes of every cell
 * points       (n_points, 3) positions of the geometry nodes in m
 * u            (n) displacement in m, by degree of freedom
 * constants    constants of the form
 * given        (n_cells, n_given) given values
 * work         (n_entries + n_dofs + n_given + 3 * n_vertices) scratch memory
 * values       result; the entries are added to what it holds */
void add_element_tensors(element_kernel *kernel, int n_cells, int n_entries, int n_dofs,
                         int n_vertices, int n_given, const int32_t *places, const int32_t *dofs,
                         const int32_t *vertices, const double *points, const double *u,
                         const double *constants, const double *given, double *work, double *values)
{
    double *tensor = work, *coefficients = work + n_entries;
    double *coordinates = coefficients + n_dofs + n_given;
    for (int cell = 0; cell < n_cells; ++cell) {
        for (int i = 0; i < n_dofs; ++i)
            coefficients[i] = u[dofs[cell * n_dofs + i]];
        for (int i = 0; i < n_given; ++i)
            coefficients[n_dofs + i] = given[cell * n_given + i];
        for (int i = 0; i < n_vertices; ++i)
            for (int k = 0; k < 3; ++k)
                coordinates[3 * i + k] = points[3 * vertices[cell * n_vertices + i] + k];
        for (int i = 0; i < n_entries; ++i)
            tensor[i] = 0.0;
        kernel(tensor, coefficients, constants, coordinates, 0, 0 AND_CUSTOM_DATA(0));
        const int32_t *place = places + (int64_t)cell * n_entries;
        for (int i = 0; i < n_entries; ++i)
            values[place[i]] += tensor[i];
    }
}
