% Entry points called by Python: set-up of module `user`, running goals with limits, interrupts and exit.

:- module(mindstage_console, [start/1, solve/4, solve_query/4, consult_file/2, on_interrupt/2]).
:- use_module(questions).
:- use_module(line_queries).
:- use_module(prefixes).
:- use_module(semweb, []).
:- use_module(veit2019_compat, []).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).
:- use_module(library(solution_sequences)).
:- use_module(library(time)).

% start(-Alarm): called for each console. Alarm is nudge if SIGUSR2 wakes Prolog without ending the process, else none.
start(Alarm) :-
    on_signal(usr2, Handler, Handler),
    (   Handler == default -> Alarm = none ; Alarm = nudge ),
    create_user_module,
    request(prefixes, Pairs),
    set_default_prefixes(Pairs),
    define_questions.

create_user_module :- module_property(mindstage, exports(_)), import_module(user, mindstage), !.
create_user_module :-
    forall(( member(Module, [mindstage_veit2019_compat, mindstage_semweb]), module_property(Module, exports(Names)) ),
           forall(member(Name, Names), mindstage:import(Module:Name))),
    forall(member(Name, [questions/0, why/1, missing/2, ask_sentence/2, ask_sentence/3]), mindstage:import(mindstage_questions:Name)),
    delete_import_module(mindstage, user),
    add_import_module(mindstage, system, start),
    add_import_module(user, mindstage, start).

% -- goals -------------------------------------------------------------------------------------------------------------

% solve(+Text, +Limit, +Seconds, -End): End is found(Rows), error_reply(Kind, Sentence), timed_out or interrupted.
solve(Text, Limit, Seconds, End) :-
    catch(solutions(Text, Limit, Seconds, End), Error, error_end(Error, End)),
    flush_output(user_output).

solutions(Text, Limit, Seconds, found(Rows)) :-
    term_string(Goal, Text, [variable_names(Variables), module(user)]),
    (   Goal == end_of_file -> syntax_error(end_of_file) ; true ),
    max_characters(user, Most),
    call_with_time_limit(Seconds, (
        findall(Variables, ( limit(Limit, user:Goal), require_size(Variables) ), Solutions),
        rows(Solutions, Most, Rows) )).

% solve_query(+Text, +Limit, +Seconds, -End): the same for a query of an untrusted client, with a memory limit.
solve_query(Text, Limit, Seconds, End) :-
    current_prolog_flag(stack_limit, Before),
    max_memory_bytes(Bytes),
    Limit0 is min(Before, Bytes),
    setup_call_cleanup(
        set_prolog_flag(stack_limit, Limit0),
        catch(query_solutions(Text, Limit, Seconds, End), Error, error_end(Error, End)),
        set_prolog_flag(stack_limit, Before)).

max_memory_bytes(33554432).

query_solutions(Text, Limit, Seconds, found(Rows)) :-
    query_goal(Text, Variables, Goal),
    max_characters(client, Most),
    call_with_time_limit(Seconds, (
        findall(Variables, ( limit(Limit, call_bounded(Goal)), acyclic_term(Variables) ), Solutions),
        rows(Solutions, Most, Rows) )).

% -- answers -----------------------------------------------------------------------------------------------------------

% max_characters(+Whom, -Most): the limit of the text of all solutions together.
max_characters(user, 256000000).
max_characters(client, 4000000).

max_parts(2000000).

% require_size(+Term): findall/3 copies a term, and then subterms that were shared are so no longer.
require_size(Term) :-
    max_parts(Most),
    (   size_abstract_term(Most, t(Term), Part), Part == t(Term) -> true
    ;   cyclic_term(Term) -> true
    ;   format(string(Sentence), "a solution has more than ~D parts", [Most]),
        throw(mindstage_error(answer_refused, Sentence))
    ).

% rows(+Solutions, +Characters, -Rows): throws if the text of the solutions is longer.
rows([], _, []).
rows([Variables|Solutions], Left, [Row|Rows]) :-
    (   cyclic_term(Variables) -> Next = Left ; text_cost(Variables, Left, Next) ),
    row(Variables, Row),
    rows(Solutions, Next, Rows).

% text_cost(+Term, +Left, -Next): subtracts the approximate length of the text of a term.
text_cost(Term, Left, Next) :-
    (   compound(Term) -> compound_name_arguments(Term, Name, Arguments), Parts = [Name|Arguments] ; Parts = [] ),
    (   atomic(Term) -> atom_length(Term, Length) ; Length = 1 ),
    Rest is Left - Length - 2,
    (   Rest < 0 -> throw(mindstage_error(answer_refused, "the text of the solutions is too long; ask for less")) ; true ),
    foldl(text_cost, Parts, Rest, Next).

row(Variables, Row) :-
    findall([Name, Cell], ( member(Name=Value, Variables), \+ sub_atom(Name, 0, _, _, '_'), cell(Value, Cell) ), Row).

% Compound terms are converted to text.
cell(Value, Value) :- \+ compound(Value), !.
cell(Value, Cells) :- is_list(Value), !, maplist(cell, Value, Cells).
cell(Value, Cell) :- format(atom(Cell), "~p", [Value]).

error_end(time_limit_exceeded, timed_out) :- !.
error_end(mindstage_interrupted, interrupted) :- !.
error_end('$aborted', interrupted) :- !.
error_end(unwind(abort), interrupted) :- !.
% The context is dropped: it may be as large as the memory limit.
error_end(error(resource_error(What), _), error_reply(prolog, Sentence)) :- !,
    format(string(Sentence), "the memory limit was exceeded (~w)", [What]).
error_end(Error, error_reply(Kind, Sentence)) :-
    (   Error = mindstage_error(Kind, _) -> true ; Kind = prolog ),
    error_message(Error, Sentence).

% Prolog's error message in one line. The context is internal, except for syntax errors.
error_message(error(Formal, Context), Sentence) :- Formal \= syntax_error(_), nonvar(Context), !,
    error_message(error(Formal, _), Sentence).
error_message(Error, Sentence) :-
    '$messages':translate_message(Error, Lines, []),
    with_output_to(string(Text), print_message_lines(current_output, '', Lines)),
    split_string(Text, "\n", " \t", Parts),
    exclude(==(""), Parts, Answers),
    atomic_list_concat(Answers, ' ', Atom),
    atom_string(Atom, Sentence).

% consult_file(+File, -Errors): the number of errors, or interrupted.
consult_file(File, Errors) :-
    statistics(errors, Before),
    catch(user:load_files(File, []), Error, consult_stopped(Error, Stopped)),
    statistics(errors, After),
    (   nonvar(Stopped) -> Errors = Stopped ; Errors is After - Before ).

consult_stopped(mindstage_interrupted, interrupted) :- !.
consult_stopped(Error, _) :- print_message(error, Error).

% on_interrupt(+Action, -Done): sets the action of Ctrl-C: debug, throw or default.
on_interrupt(throw, true) :- !, on_signal(int, _, mindstage_console:interrupted).
on_interrupt(Action, true) :- on_signal(int, _, Action).

interrupted(_) :- throw(mindstage_interrupted).

% -- exit --------------------------------------------------------------------------------------------------------------

% The last at_halt goal: Python ends the process, see PrologConsole._on_halt in console.py.
at_exit :-
    forall(( clause(system:'$at_halt'(Goal, _), true), Goal \= _:at_exit ), catch(ignore(Goal), _, true)),
    flush_output(user_output),
    flush_output(user_error),
    (   current_prolog_flag(exit_status, Status) -> true ; Status = 0 ),
    request(halting(Status), _).

:- initialization(at_halt(mindstage_console:at_exit)).

% -- messages ----------------------------------------------------------------------------------------------------------

:- multifile prolog:message//1.

prolog:message(mindstage_error(Kind, Sentence)) --> [ '~w'-[Sentence] ], mindstage_console:hint(Kind).
prolog:message(mindstage_interrupted) --> [ 'interrupted' ].
prolog:message(mindstage_unknown_name(Sentence)) --> [ '~w'-[Sentence] ].
prolog:message(mindstage_failed(Number)) -->
    [ '~D items could not be spawned; debug_failed_items lists them'-[Number] ].
prolog:message(mindstage_not_highlighted(Name, Why)) --> [ '~w cannot be highlighted: ~w'-[Name, Why] ].

hint(body_unknown) --> !, [ '; spawn_semantic_map(Map) spawns the bodies of a map' ].
hint(_) --> [].
