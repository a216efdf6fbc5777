function found = nearestNeighbor(points, varargin)
  % Number of the point nearest to each row.
  asked = double([varargin{:}]);
  points = double(points);
  found = zeros(rows(asked), 1);
  squares = sumsq(points, 2)';
  for first = 1:500:rows(asked)
    part = first:min(first + 499, rows(asked));
    [~, found(part)] = min(squares - 2 * asked(part, :) * points', [], 2);
  end
end
